"""Time per keypoint of our detectors and of COLMAP's SIFT, side by side on the same images.

    python scripts/benchmark_features.py IMAGE_FOLDER [NUM_IMAGES]

Each round runs all of them one after the other with all processors; the fastest of the rounds
counts, since other programs can only slow a run down. Both include reading nothing but pixels,
scale space, detection, orientation and the SIFT descriptor; COLMAP's also its database.
"""

from __future__ import annotations

import os
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.studies.features.images import load_images
from semsfm_colmap.studies.features.options import CompareOptions, StudyOptions
from semsfm_colmap.studies.features.study import time_features

ROUNDS = 3
DETECTORS = ("colmap-sift", "harris-hessian-laplace", "hessian-laplace", "harris-hessian-affine")


def main() -> None:
    folder = Path(sys.argv[1])
    num = int(sys.argv[2]) if len(sys.argv) > 2 else 4
    options = CompareOptions(
        study=StudyOptions(max_num_images=num), detection=DetectorOptions(max_num_features=0)
    )
    best: dict[str, tuple[float, int]] = {}
    with tempfile.TemporaryDirectory() as work, ThreadPoolExecutor(os.cpu_count()) as pool:
        images = load_images(folder, Path(work), options, IngestOptions())
        for _ in range(ROUNDS):
            for detector in DETECTORS:
                _, entry = time_features(detector, images, options, pool.map)
                now = (entry.microseconds_per_feature, entry.num_features)
                best[detector] = min(best.get(detector, now), now)
    print(f"{num} images of {folder}, fastest of {ROUNDS} rounds")
    for detector, (each, features) in best.items():
        print(f"{detector:<24}{features:>8} features {each:>8.1f} us each")


if __name__ == "__main__":
    main()
