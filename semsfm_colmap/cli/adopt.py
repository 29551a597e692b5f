"""`semsfm adopt`: take over a model that COLMAP has changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from semsfm_colmap.bounds import CountOrNone
from semsfm_colmap.cli.common import parse, positional_first
from semsfm_colmap.colmap.options import AdoptionOptions
from semsfm_colmap.io.terminal import show

if TYPE_CHECKING:
    from semsfm_colmap.colmap.adoption import ModelChange

DESCRIPTION = (
    "Compare a model that COLMAP's triangulator or bundle adjuster has changed with the project's, "
    "and take it over or refuse it with the reason."
)


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    project_path: tyro.conf.Positional[Path]
    """The project folder."""
    model_path: Path
    """Folder of the changed model, binary or text."""
    model: CountOrNone = 0
    """Number of the model below sparse/ that it comes from."""
    dry_run: bool = False
    """Only compare."""
    options: Annotated[AdoptionOptions, tyro.conf.arg(name="")] = field(
        default_factory=AdoptionOptions
    )


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.adopt import adopt_model

    parsed = parse(Arguments, positional_first(arguments), "adopt", DESCRIPTION)
    change = adopt_model(
        parsed.project_path,
        parsed.model_path,
        model=parsed.model,
        options=parsed.options,
        dry_run=parsed.dry_run,
    )
    show(table(change))
    if parsed.dry_run:
        show("would be refused: " + "; ".join(change.reasons) if change.reasons else "acceptable")
    else:
        print(
            "adopted; the old model is in sparse_before_adoption/. "
            "Depth maps, mesh and report are made again by the next `semsfm reconstruct`."
        )


def table(change: ModelChange) -> str:
    """The change in a few lines."""
    before, after = change.mean_error_px
    largest = max(float(v) for v in abs(change.magnification - 1.0))
    rows = [
        ("largest rotation", f"{float(change.rotation_deg.max()):.4f} deg"),
        ("largest change of magnification", f"{100 * largest:.4f} %"),
        ("world scaled by", f"{change.world_scale:.6g}"),
        ("points", f"{change.num_points[0]} -> {change.num_points[1]}"),
        ("observations", f"{change.num_observations[0]} -> {change.num_observations[1]}"),
        ("mean error of common ones", f"{before:.4f} -> {after:.4f} px"),
        ("from parallel projection", f"{change.max_deviation_px:.3g} px at most"),
    ]
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)
