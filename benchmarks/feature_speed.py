"""Time per keypoint of our detectors and of COLMAP's SIFT, side by side on the same images.

Each round runs all of them one after the other with all processors; the fastest of the rounds
counts, since other programs can only slow a run down. Both include reading nothing but pixels,
scale space, detection, orientation and the SIFT descriptor; COLMAP's also its database.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks import tables

ROUNDS = 3
DETECTORS = ("colmap-sift", "harris-hessian-laplace", "hessian-laplace", "harris-hessian-affine")
HEAD = ("detector", "keypoints", "us each")


def main() -> None:
    """Command line."""
    parser = tables.parser("feature_speed", __doc__)
    parser.add_argument("image_folder", type=Path)
    parser.add_argument("num_images", type=int, nargs="?", default=4)
    tables.add_page_option(parser, "feature_speed")
    args = parser.parse_args()
    # loading takes seconds, which --help need not
    from semsfm_colmap.features.options import DetectorOptions
    from semsfm_colmap.ingest.options import IngestOptions
    from semsfm_colmap.pipeline.executor import ThreadExecutor
    from semsfm_colmap.studies.features.images import load_images
    from semsfm_colmap.studies.features.options import CompareOptions, StudyOptions
    from semsfm_colmap.studies.features.study import time_features

    folder, num = args.image_folder, args.num_images
    options = CompareOptions(
        study=StudyOptions(max_num_images=num), detection=DetectorOptions(max_num_features=0)
    )
    best: dict[str, tuple[float, int]] = {}
    parallel_map = ThreadExecutor().map
    with tempfile.TemporaryDirectory() as work:
        images = load_images(folder, Path(work), options, IngestOptions())
        for _ in range(ROUNDS):
            for detector in DETECTORS:
                _, entry = time_features(detector, images, options, parallel_map)
                now = (entry.microseconds_per_feature, entry.num_features)
                best[detector] = min(best.get(detector, now), now)
    rows = [[name, number, f"{each:.1f}"] for name, (each, number) in best.items()]
    text = tables.table(HEAD, rows)
    print(f"{num} images of {folder}, fastest of {ROUNDS} rounds\n\n{text}")
    if args.markdown is not None:
        tables.put(args.markdown, "feature_speed", text)


if __name__ == "__main__":
    main()
