"""`semsfm extract`: read and prepare the images, find keypoints."""

from __future__ import annotations

from collections.abc import Sequence

from semsfm_colmap.cli.common import (
    output_config,
    parse,
    positional_first,
    verbosity,
    with_default_config,
)
from semsfm_colmap.cli.reconstruct import Arguments

DESCRIPTION = "Read and prepare the images of a folder, find keypoints in them."


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.runner import run_stages

    args = positional_first(arguments)
    parsed = parse(
        with_default_config(Arguments, output_config(args)), args, "extract", DESCRIPTION
    )
    run_stages(
        parsed.output_path,
        parsed.config,
        names=("ingest", "extract"),
        image_path=parsed.image_path,
        reporter=verbosity(parsed.verbose, parsed.quiet),
        force=parsed.force,
    )
