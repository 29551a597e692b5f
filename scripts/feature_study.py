"""The comparison of detectors and descriptors that docs/features.md shows.

    python scripts/feature_study.py DATA_FOLDER [SERIES ...]

DATA_FOLDER holds the development series. Writes docs/features/<series>/*.csv and *.png. Pictures of
specimens (figure 3) are not kept: the images have owners.
"""

from __future__ import annotations

import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.studies.features.options import CompareOptions, StudyOptions
from semsfm_colmap.studies.features.run import compare_features

SERIES = ("synth_nickel", "sem_pot1", "synth_pollen", "sem_quartz3", "synth_spore", "hotel")
NUM_IMAGES = 6
NUM_PAIRS = 2


def main() -> None:
    data = Path(sys.argv[1])
    target = Path(__file__).parents[1] / "docs" / "features"
    for name in sys.argv[2:] or SERIES:
        folder = data / name
        images = folder / "images" if (folder / "images").is_dir() else folder
        truth = folder if (folder / "truth.json").is_file() else None
        begin = time.perf_counter()
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            compare_features(
                images,
                target / name,
                options=CompareOptions(
                    study=StudyOptions(max_num_images=NUM_IMAGES, max_num_pairs=NUM_PAIRS),
                    detection=DetectorOptions(max_num_features=8192),
                    matching=MatchingOptions(),
                ),
                ingest=IngestOptions(),
                truth_path=truth,
                parallel_map=pool.map,
            )
        (target / name / "figure03.png").unlink()
        print(f"{name}: {time.perf_counter() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main()
