"""What the camera models disagree on, as a part of the error bars.

Which magnification, which drift and which stretch a camera model allows is decided by priors where
the images do not tell: the rungs of the ladder (`model_choice`) that the data do not rule out are
then equally good answers. Their spread is an error that no residual shows, common to the whole
series, and so a *mode* of the cameras (`uncertainty`): the difference of the two rungs furthest
apart, of a size such that the total rotation has the standard deviation

    half the spread of the rungs alive and of the model that is written, or, where that model is
    itself ruled out, its whole distance from the furthest of them.

With cameras (R, s, t) of one rung and (R', s', t') of the other, Q their common world rotation and
c the shift of the world that suits the translations best, the mode's parameters of image i are

    w_i = log(R'_i Q R_i^T),    log(s'_i / s_i),    t'_i + P'_i c - t_i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.alignment import align_rotations
from semsfm_colmap.geometry.rotations import vector_from_rotation
from semsfm_colmap.refinement.model_choice import ModelComparison, total_rotation
from semsfm_colmap.types import Float, Int, OrthographicCameras

MODEL_OF_RUNG = {
    "orthographic": "orthographic",
    "scaled_orthographic": "scaled, prior",
    "affine": "affine",
}
"""The rung that a camera model of the options stands on."""


@dataclass(frozen=True, kw_only=True)
class ModelSpread:
    """The disagreement of the rungs on the total rotation."""

    sigma_deg: float
    low: str
    high: str
    """Names of the rungs of the least and largest rotation among those that count"""


def spread_of(comparison: ModelComparison, camera_model: str) -> ModelSpread | None:
    """The spread about the model that is written; None where all rungs are one."""
    by_name = {rung.name: rung for rung in comparison.rungs}
    written = MODEL_OF_RUNG[camera_model]
    names = {name for name in comparison.alive if name in comparison.cameras}
    if written not in by_name or not names:
        return None
    ranges = {name: by_name[name].range_deg for name in (*names, written)}
    low, high = min(ranges, key=ranges.__getitem__), max(ranges, key=ranges.__getitem__)
    if low == high:
        return None
    if written in comparison.alive:
        return ModelSpread(sigma_deg=(ranges[high] - ranges[low]) / 2.0, low=low, high=high)
    far = max(names, key=lambda name: abs(ranges[name] - ranges[written]))
    low, high = sorted((far, written), key=ranges.__getitem__)
    return ModelSpread(sigma_deg=ranges[high] - ranges[low], low=low, high=high)


def camera_difference(
    before: OrthographicCameras, after: OrthographicCameras, param_idx: Int, num_params: int
) -> Float:
    """The step (n,) of the bundle model's parameters from one rung's cameras to the other's."""
    R, S = np.asarray(before.cam_from_world), np.asarray(after.cam_from_world)
    Q = align_rotations(S, R)
    w = vector_from_rotation(S @ Q @ R.transpose(0, 2, 1))
    log_s = np.log(after.scale_px_per_unit / before.scale_px_per_unit)
    P = after.projection @ Q
    t = after.translation_px - before.translation_px
    c = np.linalg.lstsq(P.reshape(-1, 3), -t.reshape(-1), rcond=None)[0]
    own = np.column_stack([w, log_s - log_s.mean(), t + P @ c])
    step = np.zeros(num_params + 1)  # the last one collects index -1
    step[param_idx[:, :6]] = own
    return step[:num_params]


def model_mode(
    comparison: ModelComparison, camera_model: str, param_idx: Int, num_params: int
) -> Float | None:
    """The mode (n, 1) of the cameras; None where the rungs do not differ."""
    spread = spread_of(comparison, camera_model)
    if spread is None:
        return None
    low, high = comparison.cameras[spread.low], comparison.cameras[spread.high]
    apart = np.rad2deg(
        total_rotation(np.asarray(high.cam_from_world))
        - total_rotation(np.asarray(low.cam_from_world))
    )
    if apart <= 0.0:
        return None
    step = camera_difference(low, high, param_idx, num_params)
    return (spread.sigma_deg / apart * step)[:, None]
