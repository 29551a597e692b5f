"""Perspective as a camera model: kappa of `geometry.perspective` estimated with the cameras.

An ordinary lens has ``kappa > 0`` in the right hand; the column of an electron microscope can bend
the rays the other way, and the depth-reversed model has the other sign: kappa decides no hand.

Reference points. That p is the middle of the image matters little: a shift of p common to the
series turns all cameras alike, by kappa times the shift (the depth axis is then the line of sight
instead of the optical axis). That t is not p does matter, where the specimen wanders about the
image: it is then seen from other sides. That the middle of the specimen is not on the axis it turns
about changes the magnifications, by kappa times what its distance changes; hence a prior of
magnifications that widens with kappa (`widened`).

What kappa does changes with places and depths by a share ``kappa z`` only: both are held while it
is estimated, and made anew from the result until they agree (Christy and Horaud 1996 go from affine
to perspective cameras in this way).

On a round specimen perspective looks like drag, ``kappa r^2`` like its coefficient; a fit that is
to tell whether there is perspective has the drag beside it, whose prior then widens the error bar
of kappa as far as the two cannot be told apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from semsfm_colmap.geometry.eliminated import Displacing
from semsfm_colmap.geometry.perspective import Perspective
from semsfm_colmap.geometry.points import residuals
from semsfm_colmap.refinement.adjustment import Adjustment, BundleSettings, PoseModel
from semsfm_colmap.refinement.bundle import adjust, plain_model
from semsfm_colmap.refinement.drag import DragModel
from semsfm_colmap.refinement.shared_scalar import SharedScalarModel
from semsfm_colmap.types import Float, Int, Observations, OrthographicCameras

P = TypeVar("P")

PRIOR_PER_RADIUS = 0.3
"""Standard deviation of the prior of kappa times the radius of the specimen: a lens as near as
three radii. Wide: a few hundred observations know kappa a hundred times better."""
OFF_AXIS_SHARE = 0.5
"""Standard deviation of the way of the specimen's middle along the line of sight, in radii."""
MAX_ROUNDS = 30
PRINCIPAL_ROUNDS = 4
KNOWN_SHARE = 0.5
"""Of the prior: a principal point that would be less certain stays at its guess."""
PROBE_SHARE = 0.3
"""The cost is probed so far from a place, in standard deviations of the prior."""
SETTLED_SHARE = 0.03
"""The principal point is found when it moves by less, in the same."""
SETTLED = 2e-6
"""The rounds end when kappa times the radius changes by less."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PerspectiveModel(SharedScalarModel[P]):
    """`CameraModel` of another one's parameters and kappa."""

    seen_by: OrthographicCameras
    """for places and depths only"""
    points: Float
    """(N, 3) the same"""
    principal_px: Float
    """(M, 2)"""
    centre: Float
    """(3,)"""
    sigma: float
    """of kappa's prior, 1/px"""

    @classmethod
    def build(
        cls, base: PoseModel[P], cameras: OrthographicCameras, points: Float, principal_px: Float
    ) -> PerspectiveModel[P]:
        """About the centroid of the points, with the wide prior."""
        centre = points.mean(axis=0)
        return cls(
            base=base,
            seen_by=cameras,
            points=points,
            principal_px=principal_px,
            centre=centre,
            sigma=PRIOR_PER_RADIUS / radius_of(points),
        )

    def perspective(self, kappa: float) -> Perspective:
        """With this model's reference points."""
        return Perspective(kappa=kappa, centre=self.centre, principal_px=self.principal_px)

    def displacement(self, params: tuple[P, float], image_idx: Int, track_idx: Int) -> Float:
        """(O, 2) px: what is added to the image of an affine camera, the base's with it."""
        X, view = self.points[track_idx], self.perspective(params[1])
        q = self.seen_by.project(X, image_idx)
        shown = view.seen(q, view.depth(self.seen_by, X, image_idx), image_idx) - q
        if isinstance(self.base, Displacing):
            shown = shown + self.base.displacement(params[0], image_idx, track_idx)
        return shown

    def slope(self, params: tuple[P, float], image_idx: Int, track_idx: Int) -> Float:
        """The field at this kappa."""
        return self.field(params[1], image_idx, track_idx)

    def field(self, kappa: float, image_idx: Int, track_idx: Int) -> Float:
        """Derivative of the displacement by kappa: (O, 2) px^2."""
        X, view = self.points[track_idx], self.perspective(kappa)
        q = self.seen_by.project(X, image_idx)
        return view.slope(q, view.depth(self.seen_by, X, image_idx), image_idx)


def radius_of(points: Float) -> float:
    """Root mean square distance of points (N, 3) from their middle."""
    square = np.sum((points - points.mean(axis=0)) ** 2, axis=1)
    return max(float(np.sqrt(np.mean(square))), 1e-12)


def widened(scale_sigma: float, kappa: float, radius_px: float) -> float:
    """Standard deviation of the magnifications, where the specimen's distance varies as well."""
    return float(np.hypot(scale_sigma, OFF_AXIS_SHARE * kappa * radius_px))


@dataclass(frozen=True, kw_only=True, eq=False)
class PerspectiveFit:
    """Cameras and kappa that agree with each other."""

    adjustment: Adjustment[tuple[Any, float]]
    model: PerspectiveModel[Any]
    scale_sigma: float
    """prior of the magnifications that it was found with"""

    @property
    def perspective(self) -> Perspective:
        """What was found."""
        return self.model.perspective(self.adjustment.state.params[1])

    @property
    def kappa(self) -> float:
        """1/px"""
        return self.perspective.kappa

    @property
    def cameras(self) -> OrthographicCameras:
        """The cameras as they are under parallel projection."""
        return self.adjustment.cameras

    @property
    def radius_px(self) -> float:
        """Of the points."""
        return radius_of(self.adjustment.points)

    def residuals(self, observations: Observations) -> Float:
        """(O, 2) px at observations of the same tracks, also such as the fit has not seen."""
        obs, end = observations, self.adjustment.state
        shown = self.model.displacement(end.params, obs.image_idx, obs.track_idx)
        A, t = self.model.cameras(end.params)
        return residuals(A, t, end.X, obs.image_idx, obs.track_idx, obs.xy - shown)


def fit_perspective(
    cameras: OrthographicCameras,
    points: Float,
    observations: Observations,
    principal_px: Float,
    settings: BundleSettings,
    *,
    kappa: float = 0.0,
    beside_drag: bool = False,
) -> PerspectiveFit:
    """Cameras, points and kappa of a series, from those of parallel projection.

    Parameters
    ----------
    points : (N, 3), one for each track of `observations`
    principal_px : (M, 2)
    settings : its camera model does not count: magnifications are free, aspect and skew are not
    kappa : to begin with
    beside_drag : let drag explain what it can

    """
    drag, model, fit = 0.0, None, None
    for k in range(MAX_ROUNDS):
        scale_sigma = widened(settings.scale_sigma, kappa, radius_of(points))
        base: PoseModel[Any] = plain_model(len(cameras), scale_sigma)
        params: Any = cameras
        if beside_drag:
            base = DragModel.build(base, cameras, points, observations)
            params = (cameras, drag)
        model = PerspectiveModel.build(base, cameras, points, principal_px)
        fit = adjust(model, (params, kappa), observations, settings).value
        assert fit is not None
        before, (params, kappa) = kappa, fit.state.params
        drag = params[1] if beside_drag else 0.0
        cameras, points = fit.cameras, fit.points
        if k > 0 and abs(kappa - before) * radius_of(points) < SETTLED:
            break
    assert fit is not None
    assert model is not None
    return PerspectiveFit(adjustment=fit, model=model, scale_sigma=scale_sigma)


@dataclass(frozen=True, kw_only=True, eq=False)
class PrincipalPoint:
    """Where the optical axis meets the images, against a guess."""

    offset_px: Float
    """(2,)"""
    sigma_px: float
    """standard deviation of a coordinate, root mean square"""
    fit: PerspectiveFit
    """with the point there"""


def find_principal_point(
    start: PerspectiveFit,
    observations: Observations,
    principal_px: Float,
    settings: BundleSettings,
    prior_px: float,
) -> PrincipalPoint:
    """The shift of the principal points, common to all images, that suits the observations best.

    To first order in kappa z a shift is a rotation common to all cameras, and leaves no trace; the
    second order tells them apart where there is much perspective. The cost is profiled: Newton
    steps on a quadratic through its values about a place, the prior among them. Where they would
    not halve the error of the guess, it stays.

    Parameters
    ----------
    start : of `observations`
    principal_px : (M, 2) a guess
    prior_px : standard deviation of its error

    """

    def at(offset: Float) -> PerspectiveFit:
        return fit_perspective(
            start.cameras,
            start.adjustment.points,
            observations,
            principal_px + offset,
            settings,
            kappa=start.kappa,
        )

    place, variance = np.zeros(2), prior_px**2
    step = np.eye(2) * PROBE_SHARE * prior_px
    for _ in range(PRINCIPAL_ROUNDS):
        middle = at(place).adjustment.state.cost
        ahead = [at(place + d).adjustment.state.cost for d in step]
        behind = [at(place - d).adjustment.state.cost for d in step]
        across = at(place + step.sum(axis=0)).adjustment.state.cost
        h = PROBE_SHARE * prior_px
        gradient = (np.array(ahead) - behind) / (2.0 * h)
        hessian = np.diag(np.array(ahead) + behind - 2.0 * middle) / h**2
        mixed = (across - ahead[0] - ahead[1] + middle) / h**2
        hessian[0, 1] = hessian[1, 0] = mixed
        # a chi square: twice the inverse of its second derivative is the covariance
        values, axes = np.linalg.eigh(hessian)
        hessian = (axes * np.maximum(values, 0.0)) @ axes.T + 2.0 / prior_px**2 * np.eye(2)
        variance = float(np.trace(np.linalg.inv(hessian)))
        if np.sqrt(variance) > KNOWN_SHARE * prior_px:
            return PrincipalPoint(offset_px=np.zeros(2), sigma_px=prior_px, fit=start)
        move = -np.linalg.solve(hessian, gradient + 2.0 * place / prior_px**2)
        move *= min(1.0, prior_px / max(float(np.linalg.norm(move)), 1e-300))
        place = place + move
        if np.linalg.norm(move) < SETTLED_SHARE * prior_px:
            break
    return PrincipalPoint(offset_px=place, sigma_px=float(np.sqrt(variance)), fit=at(place))


def without_perspective(
    observations: Observations,
    cameras: OrthographicCameras,
    points: Float,
    perspective: Perspective,
) -> Observations:
    """The observations as parallel projection would show them.

    Parameters
    ----------
    cameras : of all images that are numbered, zero rotations where there is none
    points : (N, 3) of all tracks; where it is nan, observations stay

    """
    obs = observations
    X = points[obs.track_idx]
    X = np.where(np.isfinite(X), X, perspective.centre)
    depth = perspective.depth(cameras, X, obs.image_idx)
    return replace(obs, xy=perspective.parallel(obs.xy, depth, obs.image_idx))
