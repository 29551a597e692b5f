"""`semsfm mesh`: the mesh of a project, or of any COLMAP folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from typing import Any

from semsfm_colmap.cli.common import (
    Quiet,
    Verbose,
    file_config,
    parse_flags,
    run_stage_command,
    verbosity,
)
from semsfm_colmap.cli.help_page import help_alone
from semsfm_colmap.surface.options import SurfaceOptions

DESCRIPTION = """Surface mesh and texture of a project. Also

  semsfm mesh --colmap_path WORKSPACE [--sparse_path MODEL] [--output_path FOLDER]

on any COLMAP folder, perspective or parallel; `semsfm mesh --colmap_path --help` has its
options."""

FOLDER_DESCRIPTION = """A mesh of any COLMAP folder, from its fused.ply, its depth maps, its images
under parallel projection or its sparse points, whichever is there first. The folder is only
read."""


@dataclass(frozen=True, kw_only=True)
class FolderArguments:
    """Arguments of the command on a COLMAP folder."""

    colmap_path: Path
    """A COLMAP workspace, dense workspace, folder of models or model; it is not changed."""
    sparse_path: Path | None = None
    """The model; default: the one with most images below the folder."""
    image_path: Path | None = None
    """The images; default: images/ in the folder."""
    output_path: Path | None = None
    """Folder of the result; default: COLMAP_PATH/mesh_semsfm."""
    config_path: Path | None = None
    """TOML file with options; flags override it."""
    verbose: Verbose = False
    """Say more."""
    quiet: Quiet = False
    """Say nothing but warnings."""


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    if not any(a.split("=")[0] == "--colmap_path" for a in arguments):
        run_stage_command("mesh", ("mesh",), arguments, DESCRIPTION)
        return
    mesh_folder(arguments)


def mesh_folder(arguments: Sequence[str], name: str = "mesh") -> None:
    """Mesh a COLMAP folder as the arguments say."""
    args = list(arguments)
    args = help_alone(args)
    surface = file_config(args).surface
    command = make_dataclass(
        FolderArguments.__name__,
        [("surface", SurfaceOptions, field(default_factory=lambda: surface))],
        bases=(FolderArguments,),
        frozen=True,
        kw_only=True,
    )
    parsed: Any = parse_flags(command, args, name, FOLDER_DESCRIPTION)
    from semsfm_colmap.pipeline.foreign.mesh_colmap import mesh_colmap
    from semsfm_colmap.surface.build import mesh_lines

    reporter = verbosity(parsed.verbose, parsed.quiet)
    record = mesh_colmap(
        parsed.colmap_path,
        parsed.output_path,
        sparse_path=parsed.sparse_path,
        image_path=parsed.image_path,
        options=parsed.surface,
        reporter=reporter,
    )
    for line in mesh_lines(record.mesh, record.world_unit):
        reporter.say(line)
