"""`semsfm compare-features`: region detectors and descriptors side by side on a series."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from semsfm_colmap.cli.common import Quiet, Verbose, parse, positional_first, verbosity
from semsfm_colmap.features.options import DescriptorOptions, DetectorOptions
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.studies.features.options import CompareOptions, StudyOptions

DESCRIPTION = (
    "Compare region detectors and descriptors on a series: how many matches each finds and keeps,"
    " which regions they share, and with --truth which matches are right. Figures and tables."
)


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    image_path: tyro.conf.Positional[Path]
    """Folder with the images."""
    output_path: Path = Path("feature_study")
    """Folder for the figures (PNG) and tables (CSV)."""
    truth: Path | None = None
    """Folder with the truth.json and mesh.npz of a rendered series."""
    verbose: Verbose = False
    """Say more."""
    quiet: Quiet = False
    """Say nothing but warnings."""
    study: Annotated[StudyOptions, tyro.conf.arg(name="")] = field(default_factory=StudyOptions)
    detection: DetectorOptions = field(
        default_factory=lambda: DetectorOptions(max_num_features=4096)
    )
    description: DescriptorOptions = field(default_factory=DescriptorOptions)
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    ingest: IngestOptions = field(default_factory=IngestOptions)


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    parsed = parse(Arguments, positional_first(arguments), "compare-features", DESCRIPTION)
    from semsfm_colmap.pipeline.executor import ThreadExecutor
    from semsfm_colmap.studies.features.run import compare_features

    reporter = verbosity(parsed.verbose, parsed.quiet)
    with reporter.progress("compare") as progress:
        result = compare_features(
            parsed.image_path,
            parsed.output_path,
            options=CompareOptions(
                study=parsed.study,
                detection=parsed.detection,
                description=parsed.description,
                matching=parsed.matching,
            ),
            ingest=parsed.ingest,
            truth_path=parsed.truth,
            parallel_map=ThreadExecutor().map,
            progress=progress,
        )
    reporter.say(f"{len(result.counts)} combinations of pairs compared; see {parsed.output_path}")
