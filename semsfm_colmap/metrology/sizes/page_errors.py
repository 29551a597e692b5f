"""The uncertainty budget of lengths and angles between vertices, for a page that has no Python.

What `metrology.sizes.covariance.Errors` knows, for vertices of the mesh only: the cameras' part as
`compact_covariance` has it, the constants of `surface_error`, and the pixel size. The page adds
them up as `Errors.sources` does; `tests/oracles/page_budget.py` is that sum in Python.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from semsfm_colmap.metrology.sizes.compact_covariance import (
    ParameterCovariance,
    compact_covariance,
)
from semsfm_colmap.metrology.sizes.covariance import Errors
from semsfm_colmap.metrology.sizes.places import at_vertices
from semsfm_colmap.metrology.sizes.quantities import distance
from semsfm_colmap.metrology.sizes.specimen import Specimen
from semsfm_colmap.metrology.sizes.surface_error import (
    FACING_CONCENTRATION,
    REACH,
    SLOW_SHARE,
    SLOW_WINDOWS,
)
from semsfm_colmap.types import Array

NUM_PLACES = 800
"""Vertices over which the cameras' part is made small."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PageErrors:
    """What the page's script needs: numbers by name, and arrays by name."""

    header: Mapping[str, Any]
    """``surface``, ``scale`` and ``cameras``, each None where it is not known, and the sentences
    ``not_assessed``"""
    arrays: Mapping[str, Array]
    """``projection`` (M, 2, 3), ``displacement`` (M, 2, B, r); none without ``cameras``"""


def page_errors(specimen: Specimen, errors: Errors) -> PageErrors | None:
    """The errors of lengths between vertices in few numbers; None without a mesh."""
    mesh = specimen.mesh
    if mesh is None or len(mesh.vertices) < 2:
        return None
    ends = [at_vertices(specimen, np.array([k])) for k in (0, len(mesh.vertices) - 1)]
    not_assessed = errors.not_assessed(distance(ends[0], ends[1], "length"))
    cameras, arrays = _cameras(specimen, errors.cameras)
    if cameras is None and errors.cameras is not None:
        not_assessed.insert(0, "cameras: this page cannot hold their covariance")
    surface, scale = errors.surface, errors.scale
    header = {
        "cameras": cameras,
        "surface": None
        if surface is None
        else {
            "common": surface.common,
            "facing": surface.facing,
            "concentration": FACING_CONCENTRATION,
            "window": surface.window,
            "reach": REACH,
            "slow_share": SLOW_SHARE,
            "slow_window": SLOW_WINDOWS * surface.window,
        },
        "scale": None if scale is None else {"name": scale.name, "sigma": scale.sigma},
        "not_assessed": not_assessed,
    }
    return PageErrors(header=header, arrays=arrays)


def _cameras(specimen: Specimen, cameras: Any) -> tuple[dict[str, Any] | None, dict[str, Array]]:
    from scipy.spatial import cKDTree

    if cameras is None:
        return None, {}
    assert specimen.mesh is not None
    known: ParameterCovariance = cameras
    vertices = specimen.mesh.vertices
    # even over the order of the vertices, in which neighbours are next to one another
    some = np.unique(np.linspace(0, len(vertices) - 1, NUM_PLACES).astype(np.int64))
    places = at_vertices(specimen, some)
    neighbors = np.asarray(cKDTree(places.points).query(places.points, 2)[1])[:, 1]
    compact = compact_covariance(known, places.points, places.normals, places.weights, neighbors)
    if compact is None:
        return None, {}
    header = {
        "exponents": compact.exponents.tolist(),
        "center": compact.center.tolist(),
        "radius": compact.radius,
        "largest_loss": compact.largest_loss,
    }
    arrays = {"projection": compact.projection, "displacement": compact.displacement}
    return header, {name: value.astype(np.float32) for name, value in arrays.items()}
