"""The commands of `semsfm`: one table. A stage of the pipeline is a command without a line here."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from semsfm_colmap.pipeline.registry import STAGES
from semsfm_colmap.pipeline.stage import Stage

Main = Callable[[Sequence[str]], None]


@dataclass(frozen=True, kw_only=True)
class Command:
    """A subcommand: its name, a line on it, and the module below `cli` that runs it."""

    name: str
    help: str
    module: str = ""
    stage: Stage | None = None
    """the stage that it runs, for a command without a module of its own"""

    def main(self) -> Main:
        """The function that runs it; its module is loaded now."""
        if self.stage is not None and not self.module:
            from semsfm_colmap.cli.stage import run_stage

            return partial(run_stage, self.stage)
        module = importlib.import_module(f"semsfm_colmap.cli.{self.module}")
        main: Main = module.main
        return main


OWN_MODULES = {"extract": "extract", "map": "map", "mesh": "mesh", "report": "report"}
"""Stages whose command does more than run them on a project folder."""

COMMANDS: tuple[Command, ...] = (
    Command(
        name="reconstruct",
        help="images to COLMAP project, mesh and report: everything below in one go",
        module="reconstruct",
    ),
    *(
        Command(
            name=stage.name, help=stage.help, module=OWN_MODULES.get(stage.name, ""), stage=stage
        )
        for stage in STAGES
        if not stage.founds
    ),
    Command(
        name="merge",
        help="several series of one specimen in one model: other axis, mounting, magnification",
        module="merge",
    ),
    Command(
        name="inspect",
        help="what the image files say: sizes, pixel size, tilt, problems",
        module="inspect",
    ),
    Command(
        name="plan",
        help="how many images over which angle for a wanted depth sigma; which angles to add",
        module="plan",
    ),
    Command(
        name="segment",
        help="specimen, coil, stalk and substrate of the surface told apart; cuts by hand",
        module="segment",
    ),
    Command(
        name="measure",
        help="lengths, angles, radii, heights, areas, volumes of the surface, with their budgets",
        module="measure",
    ),
    Command(
        name="view",
        help="the project in the browser, also while it is made: 3-D, sections, lengths, angles",
        module="view",
    ),
    Command(
        name="goniometer",
        help="how the specimen was turned: axis, angles, degrees per um of the actuator, drift",
        module="goniometer",
    ),
    Command(
        name="heightmap",
        help="heights of a surface on a grid, with ISO 25178 parameters and their uncertainties",
        module="height_map",
    ),
    Command(
        name="compare",
        help="two surfaces of one specimen, before and after: what was lost, with its bounds",
        module="compare_surfaces",
    ),
    Command(
        name="export",
        help="the model as other programs read it: COLMAP, OpenMVS, nerfstudio, PLY, ...",
        module="export",
    ),
    Command(
        name="adopt",
        help="take over a model that COLMAP's triangulator or bundle adjuster has changed",
        module="adopt",
    ),
    Command(name="evaluate", help="compare a project with known truth", module="evaluate"),
    Command(
        name="compare-features",
        help="region detectors and descriptors side by side on a series",
        module="compare_features",
    ),
    Command(
        name="synthesize",
        help="render an SEM-like series with exact truth",
        module="synthesize",
    ),
    Command(
        name="example",
        help="a small rendered series to mesh, COLMAP model and report: no images needed",
        module="example",
    ),
    Command(
        name="doctor",
        help="whether this installation is complete, and what to type where it is not",
        module="doctor",
    ),
    Command(
        name="completion",
        help="completion of commands, options and values for bash, zsh or fish",
        module="completion",
    ),
)


def find_command(name: str) -> Command | None:
    """The command of that name."""
    return next((command for command in COMMANDS if command.name == name), None)
