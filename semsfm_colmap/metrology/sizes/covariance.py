"""The uncertainty of a measured value by cause, all through its gradient by the places.

With g_S the gradient by the surface and g_R that by the rays of picked places (`metrology.places`),

- cameras: one direction of the camera parameters, to which all places add, and all parts of
  docs/truth.md (`mapping.joint_covariance`): what the places share drops out of their differences;
- surface: relief within the windows, and what is common to the surface or to all that faces the
  same way (`metrology.surface_error`);
- holes: of a region whose area or volume is asked for a share may be missing; that share of the
  value is one standard uncertainty;
- tracks: noise of their own observations, ``sigma_px^2 g^T H^-1 g``, and their relief along the
  normal (docs/truth.md);
- picking: a pixel is read to within half of one, uniformly: ``sigma = 1 / sqrt(12)`` px in x and y,
  by ``(A A^T)^-1 A g_R`` per px; perspective that only the images still have adds to it;
- scale: the pixel size is uncertain by a share, which goes with the power of the unit. Lengths in
  px have none. Where a known length sets the scale, its own uncertainty takes this place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from semsfm_colmap.metrology.sizes.places import Places, gradients
from semsfm_colmap.metrology.sizes.quantities import Quantity
from semsfm_colmap.metrology.sizes.surface_error import SurfaceError
from semsfm_colmap.types import Float, Int, OrthographicCameras

PICKING_PX = 1.0 / np.sqrt(12.0)
"""Standard deviation of a coordinate that is read to whole pixels."""

Kind = Literal["A", "B"]
CAMERA_KINDS: dict[str, Kind] = {"noise": "A", "clustered": "A"}
"""Of the parts of the cameras' errors those that the data's own scatter gives; the rest is kind
B."""


class CameraErrors(Protocol):
    """What `mapping.joint_covariance.JointCovariance` gives."""

    @property
    def noise_px(self) -> float:
        """Standard deviation of a coordinate of an observation."""
        ...

    def parts(self, direction: Float) -> dict[str, float]:
        """Standard deviations by cause."""
        ...

    def surface_direction(
        self, points: Float, normals: Float, weights: Float, gradient: Float
    ) -> Float:
        """Direction of the camera parameters for places that follow the images that see them."""
        ...

    def ray_direction(self, points: Float, normals: Float, image: Int, gradient: Float) -> Float:
        """The same for places on the rays of pixels."""
        ...


@dataclass(frozen=True, kw_only=True)
class Source:
    """A line of the budget (GUM 4.1, 5.1): what, how large, and what it does to the value."""

    name: str
    kind: Kind
    size: float | None
    """standard uncertainty of the source; None where it is made of many"""
    unit: str
    """of the size"""
    contribution: float
    """standard uncertainty of the value by it"""

    @property
    def sensitivity(self) -> float | None:
        """Size of the value's change with a unit of the source."""
        return None if not self.size else self.contribution / self.size


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """All that values of one project are uncertain by."""

    cameras: CameraErrors | None
    surface: SurfaceError | None
    model_cameras: OrthographicCameras
    relief_px: float | None
    """of reconstructed points along their normals; None: not known"""
    scale: ScaleError | None
    """None for lengths in px"""
    unit: str
    """of length"""
    picking_px: float = PICKING_PX
    """of a coordinate of a picked pixel"""

    def sources(self, quantity: Quantity) -> list[Source]:
        """The budget of a value, one line a cause."""
        places, gradient = distinct(quantity)
        by_surface, by_ray = gradients(
            places, gradient, np.asarray(self.model_cameras.viewing_direction)
        )
        found = self._camera_sources(places, by_surface, by_ray)
        found += self._surface_sources(places, by_surface)
        found += self._track_sources(places, by_surface)
        if np.any(places.image >= 0):
            picked = self._picking(places, by_ray)
            found.append(
                Source(
                    name="picking", kind="B", size=self.picking_px, unit="px", contribution=picked
                )
            )
        if quantity.missing > 0.0:
            found.append(
                Source(
                    name="surface: holes of the region",
                    kind="B",
                    size=quantity.missing,
                    unit="relative",
                    contribution=quantity.missing * abs(quantity.value),
                )
            )
        if self.scale is not None and quantity.dimension:
            found.append(
                Source(
                    name=self.scale.name,
                    kind="B",
                    size=self.scale.sigma,
                    unit="relative",
                    contribution=abs(quantity.dimension * quantity.value) * self.scale.sigma,
                )
            )
        return found

    def not_assessed(self, quantity: Quantity) -> list[str]:
        """What may matter and is in no line of the budget."""
        out = []
        if self.cameras is None:
            out.append("cameras: the observations do not determine their covariance")
        if np.any(np.isnan(quantity.places.sigma) & ~quantity.places.track):
            out.append("surface: the mesh has no sigma")
        if np.any(quantity.places.track) and self.relief_px is None:
            out.append("relief of reconstructed points: the model was written without it")
        if self.scale is None and quantity.dimension:
            out.append("pixel size: none is known, lengths are in px")
        return [
            *out,
            *quantity.not_assessed,
            "distortion of the scan beyond drift within the frames and one magnification a frame",
            "difference of scale between x and y of the scan (aspect)",
            "change of the specimen while it was imaged (charging, contamination, shrinkage)",
        ]

    def _camera_sources(self, places: Places, by_surface: Float, by_ray: Float) -> list[Source]:
        if self.cameras is None:
            return []
        d = self.cameras.surface_direction(
            places.points, places.normals, places.weights, by_surface
        )
        picked = np.flatnonzero(places.image >= 0)
        if len(picked):
            d = d + self.cameras.ray_direction(
                places.points[picked], places.normals[picked], places.image[picked], by_ray[picked]
            )
        return [
            Source(
                name=f"cameras: {name}",
                kind=CAMERA_KINDS.get(name, "B"),
                size=None,
                unit="",
                contribution=part,
            )
            for name, part in self.cameras.parts(d).items()
        ]

    def _surface_sources(self, places: Places, by_surface: Float) -> list[Source]:
        some = np.flatnonzero(~places.track & np.isfinite(places.sigma))
        if self.surface is None or len(some) == 0:
            return []
        along = np.einsum("ki,ki->k", by_surface[some], places.normals[some])
        fitted = np.isfinite(places.scatter[some])
        own = np.where(fitted, places.scatter[some], self.surface.own(places.sigma[some]))
        return [
            Source(
                name="surface: relief and noise of the windows",
                kind="A" if fitted.all() else "B",
                size=float(np.median(own)),
                unit=self.unit,
                contribution=self.surface.window_sigma(places.points[some], along, own),
            ),
            Source(
                name="surface: common offset",
                kind="B",
                size=self.surface.common,
                unit=self.unit,
                contribution=self.surface.common_sigma(along),
            ),
            Source(
                name="surface: offset by where it faces",
                kind="B",
                size=self.surface.facing,
                unit=self.unit,
                contribution=self.surface.facing_sigma(places.normals[some], along),
            ),
        ]

    def _track_sources(self, places: Places, gradient: Float) -> list[Source]:
        some = np.flatnonzero(places.track)
        if len(some) == 0:
            return []
        found = []
        g = gradient[some]
        if self.cameras is not None:
            A = self.model_cameras.projection
            H = np.einsum("km,mxi,mxj->kij", places.weights[some], A, A)
            y = np.linalg.solve(H, g[:, :, None])[:, :, 0]
            size = self.cameras.noise_px
            noise = size * float(np.sqrt(np.sum(g * y)))
            found.append(
                Source(name="points: noise", kind="A", size=size, unit="px", contribution=noise)
            )
        if self.relief_px is not None:
            along = np.einsum("ki,ki->k", g, places.normals[some])
            px = 1.0 / self.model_cameras.mean_scale_px_per_unit
            contribution = self.relief_px * px * float(np.linalg.norm(along))
            found.append(
                Source(
                    name="points: relief",
                    kind="B",
                    size=self.relief_px,
                    unit="px",
                    contribution=contribution,
                )
            )
        return found

    def _picking(self, places: Places, by_ray: Float) -> float:
        picked = np.flatnonzero(places.image >= 0)
        A = self.model_cameras.projection[places.image[picked]]
        back = np.linalg.solve(A @ A.transpose(0, 2, 1), A @ by_ray[picked][:, :, None])
        return float(self.picking_px * np.linalg.norm(back))


def distinct(quantity: Quantity) -> tuple[Places, Float]:
    """The places of a value, each once, with the sums of their gradients (K, 3)."""
    where, image = quantity.places.points, quantity.places.image
    key = np.column_stack([where, image])
    _, first, number = np.unique(key, axis=0, return_index=True, return_inverse=True)
    gradient = np.zeros((len(first), 3))
    np.add.at(gradient, number.reshape(-1), quantity.gradient)
    return quantity.places.select(first), gradient


@dataclass(frozen=True, kw_only=True)
class ScaleError:
    """The pixel size's own uncertainty."""

    sigma: float
    """relative standard deviation"""
    name: str = "pixel size"
