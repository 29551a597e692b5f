"""The formats by name: what each writes, which names it can hold, what it needs."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.errors import UsageError
from semsfm_colmap.exports.names import ANY_NAME, LIST_NAME, NO_SPACES, NameRule
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, Summary

Writer = Callable[[ExportScene, Path, FormatOptions], Summary]


@dataclass(frozen=True, kw_only=True)
class Format:
    """One export format; its module is imported when it is used."""

    module: str
    function: str = "write"
    description: str
    name_rule: NameRule = ANY_NAME
    copies_images: bool = True
    """Whether the images are part of the export"""
    uses_depth: bool = False

    def writer(self) -> Writer:
        """The function that fills a folder."""
        module = importlib.import_module(f"semsfm_colmap.exports.{self.module}")
        writer: Writer = getattr(module, self.function)
        return writer


FORMATS: dict[str, Format] = {
    "colmap-bin": Format(
        module="colmap_model",
        function="write_binary",
        description="COLMAP model, binary, telecentric focal length",
        copies_images=False,
    ),
    "colmap-text": Format(
        module="colmap_model",
        function="write_text",
        description="COLMAP model, text, telecentric focal length",
        name_rule=NO_SPACES,
        copies_images=False,
    ),
    "colmap-float32": Format(
        module="colmap_model",
        function="write_float32",
        description="images/ and sparse/0 with a shorter focal length: splatting, viewers",
    ),
    "colmap-dense": Format(
        module="dense_workspace",
        description="COLMAP's dense workspace with our depth and normal maps",
        name_rule=LIST_NAME,
        uses_depth=True,
    ),
    "database-38": Format(
        module="database_38",
        description="the database in COLMAP 3.8's schema, and the model that shares its ids",
        copies_images=False,
    ),
    "openmvs": Format(
        module="openmvs",
        description="images/ and sparse/ as InterfaceCOLMAP reads them",
        name_rule=NO_SPACES,
    ),
    "bundler": Format(
        module="bundler",
        description="bundle.out and bundle.list.txt",
        name_rule=NO_SPACES,
        copies_images=False,
    ),
    "nvm": Format(
        module="nvm",
        description="VisualSFM's model.nvm",
        name_rule=NO_SPACES,
        copies_images=False,
    ),
    "ply": Format(
        module="ply",
        description="points with normals and sigma",
        copies_images=False,
    ),
    "nerfstudio": Format(
        module="nerfstudio",
        description="transforms.json, images/ and sparse_pc.ply",
    ),
    "nfh-sem": Format(
        module="nfh_sem",
        description="orthographic cameras, depth and normals as npz",
        uses_depth=True,
    ),
}


def find_format(name: str) -> Format:
    """The format of a name; one sentence with the nearest one when there is none."""
    if name not in FORMATS:
        import difflib

        near = difflib.get_close_matches(name, FORMATS, n=1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise UsageError(f"unknown format {name}: {hint}the formats are {', '.join(FORMATS)}")
    return FORMATS[name]
