"""What a specimen is, and what its builder knows about the images to be taken of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from semsfm_colmap.types import Float, Int

SPECIMEN = 0
SUPPORT = 1
"""Labels of vertices: the specimen itself, and what holds it (stalk, ribbon)."""


@dataclass(frozen=True, kw_only=True)
class View:
    """How the specimen will be seen, in scene units."""

    edge: float
    """Length that the edges of triangles should have"""
    half_width: float
    half_height: float
    """Half the extent of the image area, the drift of the stage included"""
    max_tilt_rad: float
    """Largest angle between the viewing direction and the specimen's z axis"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Specimen:
    """A surface and its material; x right, y down, z away from the viewer at angle 0."""

    vertices: Float
    """(V, 3)"""
    faces: Int
    """(F, 3), counter-clockwise seen from outside"""
    texture: Float
    """(V,) brightness of the material apart from its relief, mean 0 and variance 1"""
    label: Int
    """(V,) SPECIMEN or SUPPORT"""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """What to write into the truth: counts and sizes of the parts"""
