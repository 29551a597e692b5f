"""Bundle adjustment against Ceres (pycolmap), on one model to the same cost."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.geometry.series import NOISE_PX, Series, simulate
from benchmarks.tables import table
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.telecentric import pinhole_cameras
from semsfm_colmap.geometry.eliminated import SolverOptions
from semsfm_colmap.geometry.points import solve_points, track_pointer
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import BundleModel, bundle_adjust
from semsfm_colmap.types import Observations, OrthographicCameras

NUM_IMAGES = 60
FOCAL_PX = 1e6
SIZE_PX = 1200
COST_TOLERANCE = 1e-8
HEAD = ["observations", "our cost px^2", "Ceres cost px^2", "ours s", "Ceres s", "times faster"]


def make(data: Path, quick: bool) -> str:
    """Both start from the same disturbed cameras and points and end at the same cost."""
    rows = []
    for tracks in (6000,) if quick else (6000, 15000):
        s = simulate(Series(NUM_IMAGES, 180.0, tracks, "body", 8), True, 0)
        rng = np.random.default_rng(1)
        start = BundleModel.build(
            NUM_IMAGES, free_scale=False, free_affine=False, scale_sigma=1.0, affine_sigma=1.0
        ).retract(s.cameras, 0.002 * rng.normal(size=5 * NUM_IMAGES))
        our_cost, ours = adjust_ours(start, s.observations)
        their_cost, theirs = adjust_theirs(pinhole_model(start, s.observations))
        rows.append(
            [
                len(s.observations),
                f"{our_cost:.1f}",
                f"{their_cost:.1f}",
                f"{ours:.2f}",
                f"{theirs:.2f}",
                f"{theirs / ours:.1f}",
            ]
        )
        print(rows[-1], flush=True)
    return table(HEAD, rows)


def adjust_ours(start: OrthographicCameras, observations: Observations) -> tuple[float, float]:
    """Sum of the squared residuals and seconds of the program's adjustment, once compiled."""
    settings = BundleSettings(
        scale_sigma=10.0,
        sigma_px=NOISE_PX,
        solver=SolverOptions(cost_tolerance=COST_TOLERANCE),
    )
    for _ in range(2):
        begin = time.monotonic()
        fit = bundle_adjust(start, observations, settings)
        seconds = time.monotonic() - begin
    assert fit.value is not None
    return float(np.sum(fit.value.residuals**2)), seconds


def adjust_theirs(model: Any) -> tuple[float, float]:
    """Sum of the squared residuals and seconds of pycolmap's adjustment."""
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = False
    options.refine_extra_params = False
    options.print_summary = False
    options.ceres.solver_options.function_tolerance = COST_TOLERANCE
    options.ceres.solver_options.max_num_iterations = 200
    begin = time.monotonic()
    pycolmap.bundle_adjustment(model, options)
    seconds = time.monotonic() - begin
    cost = 0.0
    for point in model.points3D.values():
        for e in point.track.elements:
            image = model.images[e.image_id]
            d = image.project_point(point.xyz) - image.points2D[e.point2D_idx].xy
            cost += float(d @ d)
    return cost, seconds


def pinhole_model(start: OrthographicCameras, obs: Observations) -> Any:
    """The cameras, and points triangulated with them, as a pycolmap reconstruction."""
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    X = solve_points(
        start.projection,
        np.asarray(start.translation_px),
        obs.image_idx,
        pointer,
        obs.xy,
        np.ones(len(obs)),
    )
    model = pycolmap.Reconstruction()
    middle = SIZE_PX / 2.0
    camera = pycolmap.Camera(
        model="SIMPLE_PINHOLE",
        width=SIZE_PX,
        height=SIZE_PX,
        params=[FOCAL_PX, middle, middle],
        camera_id=1,
    )
    model.add_camera_with_trivial_rig(camera)
    T = pinhole_cameras(start, np.full((len(start), 2), SIZE_PX), FOCAL_PX).translation
    number = np.empty(len(obs), dtype=int)
    for i in range(len(start)):
        o = np.flatnonzero(obs.image_idx == i)
        number[o] = np.arange(len(o))
        image = pycolmap.Image(
            name=f"{i}.png", keypoints=np.array(obs.xy[o]), camera_id=1, image_id=i + 1
        )
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array(start.cam_from_world[i])), T[i])
        model.add_image_with_trivial_frame(image, pose)
    for j in range(obs.num_tracks):
        track = pycolmap.Track()
        for row in range(pointer[j], pointer[j + 1]):
            track.add_element(int(obs.image_idx[row]) + 1, int(number[row]))
        model.add_point3D(X[j], track, np.zeros(3, dtype=np.uint8))
    return model
