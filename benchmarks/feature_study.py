"""The comparison of detectors and descriptors that docs/features.md shows.

DATA_FOLDER holds the development series. Writes docs/features/<series>/*.csv and *.png, of which
benchmarks.feature_tables makes tables. Pictures of specimens (figure 3) are not kept: the images
have owners.
"""

from __future__ import annotations

import time
from pathlib import Path

from benchmarks import tables

SERIES = ("synth_nickel", "sem_pot1", "synth_pollen", "sem_quartz3", "synth_spore", "hotel")
NUM_IMAGES = 6
NUM_PAIRS = 2


def main() -> None:
    """Command line."""
    parser = tables.parser("feature_study", __doc__)
    parser.add_argument("data_folder", type=Path)
    parser.add_argument("series", nargs="*", default=SERIES)
    parser.add_argument("--output", type=Path, default=Path("docs/features"))
    args = parser.parse_args()
    # loading takes seconds, which --help need not
    from semsfm_colmap.features.options import DetectorOptions
    from semsfm_colmap.ingest.options import IngestOptions
    from semsfm_colmap.matching.options import MatchingOptions
    from semsfm_colmap.pipeline.executor import ThreadExecutor
    from semsfm_colmap.studies.features.options import CompareOptions, StudyOptions
    from semsfm_colmap.studies.features.run import compare_features

    for name in args.series:
        folder = args.data_folder / name
        images = folder / "images" if (folder / "images").is_dir() else folder
        truth = folder if (folder / "truth.json").is_file() else None
        begin = time.perf_counter()
        compare_features(
            images,
            args.output / name,
            options=CompareOptions(
                study=StudyOptions(max_num_images=NUM_IMAGES, max_num_pairs=NUM_PAIRS),
                detection=DetectorOptions(max_num_features=8192),
                matching=MatchingOptions(),
            ),
            ingest=IngestOptions(),
            truth_path=truth,
            parallel_map=ThreadExecutor().map,
        )
        (args.output / name / "figure03.png").unlink()
        print(f"{name}: {time.perf_counter() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main()
