"""What an adjustment of cameras is told, and what it ends with."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from semsfm_colmap.geometry.eliminated import CameraModel, Eliminated, SolverOptions
from semsfm_colmap.refinement.options import CameraModelName, RefinementOptions
from semsfm_colmap.types import Float, OrthographicCameras

P = TypeVar("P")

CHI_SQUARE_TOLERANCE = 0.02
"""Stop after a step that lowers chi square by less. The steps converge by a factor of ten or more
each, so what is left is below 0.002: no parameter is off by more than 5 % of its sigma."""
EARLY_ITERATIONS = 8
"""Steps of the bundle adjustment in all rounds but the last: enough to move before refiltering."""


class PoseModel(CameraModel[P], Protocol[P]):
    """A camera parametrisation whose first parameters are those of `BundleModel`.

    Any further ones must not matter to a rotation or shift of the world.
    """

    def poses(self, params: P) -> OrthographicCameras:
        """The orthographic cameras among the parameters."""
        ...


@dataclass(frozen=True, kw_only=True)
class BundleSettings:
    """Which parameters of the cameras are free, how far their priors let them go, the search."""

    camera_model: CameraModelName = "scaled_orthographic"
    scale_sigma: float = 0.001
    """relative standard deviation of the magnification between images"""
    affine_sigma: float = 0.003
    """standard deviation of aspect - 1 and skew, with the affine model"""
    drift_sigma_px: float = 0.0
    """standard deviation of the scan drift over the height of a frame; 0: none is sought"""
    drag_sigma_px: float = 0.0
    """standard deviation of the drag's coefficient; 0: none is sought"""
    sigma_px: float = 0.3
    """measurement noise per coordinate; balances the data against the priors"""
    solver: SolverOptions = field(default_factory=SolverOptions)

    @classmethod
    def of(
        cls, options: RefinementOptions, sigma_px: float, solver: SolverOptions
    ) -> BundleSettings:
        """What the options of the stage say, for observations of this noise."""
        return cls(
            camera_model=options.camera_model,
            scale_sigma=options.scale_sigma,
            affine_sigma=options.affine_sigma,
            drift_sigma_px=options.drift_sigma_px,
            drag_sigma_px=options.drag_sigma_px,
            sigma_px=sigma_px,
            solver=solver,
        )


def early_solver(options: RefinementOptions) -> SolverOptions:
    """The search while wrong observations are still being filtered."""
    return SolverOptions(
        max_iterations=EARLY_ITERATIONS,
        cost_tolerance=1e-4,
        absolute_tolerance=CHI_SQUARE_TOLERANCE,
        loss=options.loss,
        loss_width=options.loss_width,
    )


def last_solver(options: RefinementOptions) -> SolverOptions:
    """The search that ends in the model."""
    return SolverOptions(
        max_iterations=options.max_iterations,
        absolute_tolerance=CHI_SQUARE_TOLERANCE,
        loss=options.last_loss,
        loss_width=options.loss_width,
    )


def comparing_solver(options: RefinementOptions) -> SolverOptions:
    """The search of the many fits that are only compared with one another."""
    return SolverOptions(
        max_iterations=options.max_iterations,
        cost_tolerance=1e-7,
        absolute_tolerance=1e-2,
        loss=options.last_loss,
        loss_width=options.loss_width,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Adjustment(Generic[P]):
    """The end of a search: the model and the state, from which error bars can be made."""

    model: PoseModel[P]
    state: Eliminated[P]

    @property
    def cameras(self) -> OrthographicCameras:
        """The adjusted cameras."""
        return self.model.poses(self.state.params)

    @property
    def points(self) -> Float:
        """(N, 3) the best points for them."""
        return self.state.X

    @property
    def residuals(self) -> Float:
        """(O, 2) px"""
        return self.state.residuals
