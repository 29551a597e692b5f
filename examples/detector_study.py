"""Region detectors and descriptors side by side on a series: the paper's figures 12, 13, table 1.

    python examples/detector_study.py IMAGES OUTPUT

How many matches each pair of detector and descriptor finds, how many survive the filters, and
which regions they share. `semsfm compare-features` does the same with all options.
"""

from __future__ import annotations

import sys
from pathlib import Path

from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.studies.features.options import CompareOptions, StudyOptions
from semsfm_colmap.studies.features.run import compare_features


def main(image_path: Path, output_path: Path) -> None:
    """Compare three detectors under SIFT descriptors."""
    options = CompareOptions(
        study=StudyOptions(
            detectors=("harris-laplace", "hessian-laplace", "colmap-sift"), descriptors=("sift",)
        ),
        detection=DetectorOptions(max_num_features=1024),
    )
    compare_features(image_path, output_path, options=options, ingest=IngestOptions())
    for table in sorted(output_path.glob("*.csv")):
        print(f"{table.name}:")
        print("  " + "\n  ".join(table.read_text(encoding="utf-8").splitlines()[:6]))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
