"""The formats by name: what each writes, which names it can hold. Imports nothing heavy."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from semsfm_colmap.errors import UsageError
from semsfm_colmap.exports.names import ANY_NAME, LIST_NAME, NO_SPACES, NameRule
from semsfm_colmap.exports.options import FormatOptions

if TYPE_CHECKING:
    from semsfm_colmap.exports.scene import ExportScene, Summary

    Writer = Callable[[ExportScene, Path, FormatOptions], Summary]


@dataclass(frozen=True)
class Format:
    """One export format, written by the module of its name in formats/."""

    name: str
    description: str
    name_rule: NameRule = ANY_NAME
    copies_images: bool = True
    """Whether the images are part of the export"""
    module_name: str = ""
    """Of the module, where it is not the format's name with underscores"""

    @property
    def module(self) -> str:
        """The module that writes it."""
        name = self.module_name or self.name.replace("-", "_")
        return f"semsfm_colmap.exports.formats.{name}"

    def writer(self) -> Writer:
        """The function that fills a folder; its module is imported now."""
        writer: Writer = importlib.import_module(self.module).write
        return writer


_ALL = (
    Format("colmap-bin", "COLMAP model, binary, telecentric focal length", copies_images=False),
    Format("colmap-text", "COLMAP model, text", NO_SPACES, copies_images=False),
    Format("colmap-float32", "images/ and sparse/0 at a shorter focal length: splatting, viewers"),
    Format("colmap-dense", "COLMAP's dense workspace with our depth and normal maps", LIST_NAME),
    Format("database-38", "database in COLMAP 3.8's schema, model of its ids", copies_images=False),
    Format("openmvs", "images/ and sparse/ as InterfaceCOLMAP reads them", NO_SPACES),
    Format("bundler", "bundle.out and bundle.list.txt", NO_SPACES, copies_images=False),
    Format("nvm", "VisualSFM's model.nvm", NO_SPACES, copies_images=False),
    Format("ply", "points with normals and sigma", copies_images=False),
    Format("stl", "the mesh in millimetres, for printing", copies_images=False),
    Format(
        "3mf",
        "the mesh in millimetres with its unit, for printing",
        copies_images=False,
        module_name="threemf",
    ),
    Format("nerfstudio", "transforms.json, images/ and sparse_pc.ply"),
    Format("nfh-sem", "orthographic cameras, depth and normals as npz"),
    Format("imod", "an aligned etomo folder: stack, .xf, .tlt, fiducials", copies_images=False),
    Format("aretomo", "stack and .aln alignment of AreTomo", copies_images=False),
    Format("relion-star", "stack and RELION 5's star files", copies_images=False),
)
FORMATS = {format_.name: format_ for format_ in _ALL}


def find_format(name: str) -> Format:
    """The format of a name; one sentence with the nearest one when there is none."""
    if name not in FORMATS:
        import difflib

        near = difflib.get_close_matches(name, FORMATS, n=1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise UsageError(f"unknown format {name}: {hint}the formats are {', '.join(FORMATS)}")
    return FORMATS[name]
