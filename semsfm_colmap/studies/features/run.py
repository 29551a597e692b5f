"""`semsfm compare-features`: the paper's study on the images of a folder, written as figures."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.features.registry import descriptor_entry, detector_parts
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.io.temporary import temporary_folder
from semsfm_colmap.studies.features.figures import write_figures
from semsfm_colmap.studies.features.images import load_images
from semsfm_colmap.studies.features.options import CompareOptions
from semsfm_colmap.studies.features.result import StudyResult
from semsfm_colmap.studies.features.study import Progress, run_study
from semsfm_colmap.studies.features.tables import write_tables
from semsfm_colmap.types import ParallelMap


def compare_features(
    image_path: Path,
    output_path: Path,
    *,
    options: CompareOptions,
    ingest: IngestOptions,
    truth_path: Path | None = None,
    parallel_map: ParallelMap = map,
    progress: Progress | None = None,
) -> StudyResult:
    """Run the study on a folder of images and write its figures and tables to `output_path`."""
    for detector in options.study.detectors:
        detector_parts(detector)
    for descriptor in options.study.descriptors:
        descriptor_entry(descriptor)
    truth = load_truth(truth_path) if truth_path is not None else None
    with temporary_folder() as folder:
        images = load_images(
            Path(image_path), Path(folder), options, ingest, truth, parallel_map=parallel_map
        )
        result = run_study(images, options, parallel_map=parallel_map, progress=progress)
    write_tables(result, output_path)
    write_figures(result, output_path, images.pixels[0])
    return result
