"""`semsfm segment`: specimen, coil, stalk and substrate told apart; cuts by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, make_dataclass, replace
from pathlib import Path

import tyro

from semsfm_colmap.cli.common import (
    Quiet,
    file_config,
    parse,
    positional_first,
    verbosity,
)
from semsfm_colmap.segmentation.cuts import Cut
from semsfm_colmap.segmentation.names import DROPPED, NAMES
from semsfm_colmap.segmentation.options import SegmentationOptions

DESCRIPTION = """Tell the parts of a project's surface apart and label them (docs/segmentation.md).

Without a cut: specimen and what holds it. A cut is kept in PROJECT/segments.toml and done again
each time; --undo takes the last one back. Nothing is ever deleted. Lengths are in world units."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    project_path: tyro.conf.Positional[Path]
    """The project folder, after densify; the mesh is labelled where there is one."""
    box: tuple[float, float, float, float, float, float] | None = None
    """Cut: lower x y z, upper x y z."""
    sphere: tuple[float, float, float, float] | None = None
    """Cut: centre x y z, radius."""
    plane: tuple[float, float, float, float] | None = None
    """Cut: the side a x + b y + c z > d, as a b c d."""
    mask_folder: Path | None = None
    """Cut: what masks named <image name>.png leave out (0) in most images that show it."""
    keep: str | None = None
    """Cut: all parts but this one."""
    drop: str | None = None
    """Cut: this part."""
    as_label: str = NAMES[DROPPED]
    """The name that box, sphere, plane and mask_folder give to what they take."""
    outside: bool = False
    """Box, sphere, plane and mask_folder take what is outside of them."""
    undo: bool = False
    """Take the last cut back, before any new one."""
    quiet: Quiet = False
    """Say nothing but warnings."""
    segmentation: SegmentationOptions = field(default_factory=SegmentationOptions)


def cuts_of(parsed: Arguments) -> list[Cut]:
    """The cuts that the flags ask for, in the order of the help."""
    cuts = []
    if parsed.box is not None:
        cuts.append(Cut(kind="box", values=parsed.box))
    if parsed.sphere is not None:
        cuts.append(Cut(kind="sphere", values=parsed.sphere))
    if parsed.plane is not None:
        cuts.append(Cut(kind="plane", values=parsed.plane))
    if parsed.mask_folder is not None:
        cuts.append(Cut(kind="masks", text=str(parsed.mask_folder.resolve())))
    cuts = [replace(cut, label=parsed.as_label, outside=parsed.outside) for cut in cuts]
    if parsed.keep is not None:
        cuts.append(Cut(kind="keep", text=parsed.keep))
    if parsed.drop is not None:
        cuts.append(Cut(kind="drop", text=parsed.drop))
    return cuts


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.segment import segment_project

    args = positional_first(arguments)
    project = Path(args[0]) if args and not args[0].startswith("-") else None
    options = file_config(args, project).segmentation
    command = make_dataclass(
        "SegmentArguments",
        [("segmentation", SegmentationOptions, field(default_factory=lambda: options))],
        bases=(Arguments,),
        frozen=True,
        kw_only=True,
    )
    parsed: Arguments = parse(command, args, "segment", DESCRIPTION)
    segment_project(
        parsed.project_path,
        parsed.segmentation,
        new_cuts=cuts_of(parsed),
        undo=int(parsed.undo),
        reporter=verbosity(False, parsed.quiet),
    )
