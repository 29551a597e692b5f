"""The meshers by name. Imports nothing heavy."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from semsfm_colmap.errors import UsageError

if TYPE_CHECKING:
    from semsfm_colmap.surface.mesh.methods.task import MeshTask, RawSurface
    from semsfm_colmap.surface.options import SurfaceOptions

    Mesher = Callable[[MeshTask, SurfaceOptions], RawSurface]


@dataclass(frozen=True)
class Method:
    """A way from points to triangles, made by the module of its name in this folder."""

    name: str
    module_name: str
    description: str
    thins: bool = True
    """Points are merged and smoothed before, and small pieces dropped after"""
    sees_views: bool = False
    """Depth maps take part, in the units of the world"""

    def mesher(self) -> Mesher:
        """The function that makes the triangles; its module is imported now."""
        module = importlib.import_module(f"{__package__}.{self.module_name}")
        mesher: Mesher = module.make_surface
        return mesher


_ALL = (
    Method("ball-pivoting", "ball_pivoting", "keeps to the points, leaves open what nobody saw"),
    Method("poisson", "poisson", "smooth implicit surface, trimmed where there are no points"),
    Method(
        "tsdf",
        "tsdf",
        "signed distance on a grid, from depth maps where there are any",
        sees_views=True,
    ),
    Method("delaunay-2.5d", "delaunay", "height over the mean viewing direction: fields"),
    Method("convex-hull", "convex_hull", "the smallest convex body around the points", thins=False),
)
METHODS = {method.name: method for method in _ALL}


def find_method(name: str) -> Method:
    """The method of a name; one sentence with the nearest one when there is none."""
    if name not in METHODS:
        import difflib

        near = difflib.get_close_matches(name, METHODS, n=1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise UsageError(
            f"unknown surface.method {name}: {hint}the methods are {', '.join(METHODS)}"
        )
    return METHODS[name]
