"""Sparse models without orthographic.json, and round trips of every kind of series."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.colmap.database.work import DatabaseImage
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.pinhole_reading import read_pinhole_model
from semsfm_colmap.colmap.model.sparse import read_model, write_model
from semsfm_colmap.colmap.options import ExportOptions
from semsfm_colmap.errors import InputError
from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.types import Reconstruction

SERIES = {
    "grain over a half turn": (48, 180.0, "body", 5e-4),
    "field, wide tilt": (13, 60.0, "field", 5e-4),
    "closed turn": (72, 355.0, "body", 3e-4),
    "four small steps": (4, 9.0, "body", 1e-3),
    "three views": (3, 12.0, "field", 1e-3),
    "strong magnification drift": (8, 70.0, "body", 3e-2),
}


def simulated(num: int, range_deg: float, body: str, drift: float) -> Reconstruction:
    s = simulate_tracks(
        num_images=num,
        range_deg=range_deg,
        num_tracks=150,
        body=body,
        scale_drift=drift,
        rng=np.random.default_rng(1),
    )
    obs = s.observations
    keypoint = np.empty(len(obs), dtype=np.int64)
    for i in range(num):
        rows = np.flatnonzero(obs.image_idx == i)
        keypoint[rows] = np.arange(len(rows))
    seen = np.bincount(obs.track_idx, minlength=obs.num_tracks) > 1
    number = np.cumsum(seen) - 1
    keep = seen[obs.track_idx]
    obs = replace(
        obs.select(keep),
        track_idx=number[obs.track_idx[keep]],
        keypoint_idx=keypoint[keep],
        num_tracks=int(seen.sum()),
    )
    # the images are as large as the observations need
    return Reconstruction(
        image_names=tuple(f"{i:03d}.png" for i in range(num)),
        image_size_px=np.full((num, 2), 1024),
        cameras=s.cameras,
        points=s.points[seen],
        observations=obs,
        inlier=np.ones(len(obs), dtype=bool),
    )


def write(made: Reconstruction, path: Path, **options: float) -> float:
    images = {
        n: DatabaseImage(image_id=k + 1, name=n, camera_id=1)
        for k, n in enumerate(made.image_names)
    }
    obs = made.observations
    keypoints = {}
    for i, name in enumerate(made.image_names):
        rows = obs.image_idx == i
        xy = np.zeros((int(obs.keypoint_idx[rows].max()) + 1, 2))
        xy[obs.keypoint_idx[rows]] = obs.xy[rows]
        keypoints[name] = xy
    return write_model(made, path, images, keypoints, ExportOptions(**options)).max_deviation_px


@pytest.mark.parametrize("kind", SERIES, ids=lambda k: k.replace(" ", "_"))
def test_model_to_disk_to_types_to_disk_is_identical_and_within_its_bound(kind, tmp_path) -> None:
    made = simulated(*SERIES[kind])
    stated = write(made, tmp_path / "a")
    back = read_model(tmp_path / "a")
    write(back, tmp_path / "b")
    for name in ("cameras", "images", "points3D"):
        a, b = (tmp_path / f / f"{name}.bin" for f in "ab")
        assert a.read_bytes() == b.read_bytes()
    a, b = (tmp_path / f / "orthographic.json" for f in "ab")
    assert a.read_bytes() == b.read_bytes()
    # every observation: COLMAP's own camera against the sidecar's
    model = pycolmap.Reconstruction(str(tmp_path / "a"))
    worst = 0.0
    for image in model.images.values():
        i = back.image_names.index(image.name)
        owned = [p for p in image.points2D if p.has_point3D()]
        X = np.array([model.points3D[p.point3D_id].xyz for p in owned])
        theirs = np.array([image.project_point(x) for x in X])
        ours = back.cameras.project(X, np.full(len(X), i))
        worst = max(worst, float(np.linalg.norm(theirs - ours, axis=1).max()))
    assert worst <= stated + 1e-6
    assert stated <= 0.0404


@pytest.mark.parametrize("kind", SERIES, ids=lambda k: k.replace(" ", "_"))
def test_without_the_sidecar_the_deviation_is_measured(kind, tmp_path) -> None:
    made = simulated(*SERIES[kind])
    stated = write(made, tmp_path / "a")
    (tmp_path / "a" / "orthographic.json").unlink()
    reading = read_pinhole_model(tmp_path / "a")
    back = reading.reconstruction
    # a stand-in through the centroid is no worse than twice the bound of one through the origin
    assert reading.max_deviation_px <= 2 * stated
    rows = np.arange(len(made.observations))
    X = made.points[made.observations.track_idx[rows]]
    gap = back.cameras.project(X, made.observations.image_idx) - made.cameras.project(
        X, made.observations.image_idx
    )
    assert np.linalg.norm(gap, axis=1).max() <= 3 * stated
    assert np.array_equal(back.observations.xy, made.observations.xy)
    error = np.linalg.norm(made.residuals(), axis=1).mean()
    assert reading.mean_reprojection_error_px == pytest.approx(error, abs=0.01)
    assert reading.camera_models == ("SIMPLE_PINHOLE",)
    assert back.depth_sign.status == "ambiguous"


def test_text_and_other_long_focal_cameras_are_read_too(tmp_path) -> None:
    made = simulated(*SERIES["field, wide tilt"])
    write(made, tmp_path / "a")
    model = pycolmap.Reconstruction(str(tmp_path / "a"))
    for camera in model.cameras.values():
        f, cx, cy = camera.params
        camera.model = pycolmap.CameraModelId.OPENCV
        camera.params = [f, f, cx, cy, 0.0, 0.0, 0.0, 0.0]
    (tmp_path / "text").mkdir()
    model.write_text(str(tmp_path / "text"))
    reading = read_pinhole_model(tmp_path / "text")
    assert reading.camera_models == ("OPENCV",)
    assert reading.max_deviation_px < 0.08


def test_a_perspective_model_is_refused_with_its_deviation(tmp_path) -> None:
    made = simulated(*SERIES["field, wide tilt"])
    write(made, tmp_path / "a", max_deviation_px=30.0)
    model = pycolmap.Reconstruction(str(tmp_path / "a"))
    for camera in model.cameras.values():
        f, cx, cy = camera.params
        camera.params = [f / 20, cx, cy]
    for frame in model.frames.values():
        pose = frame.rig_from_world
        t = np.array(pose.translation)
        t[2] /= 20
        frame.rig_from_world = pycolmap.Rigid3d(pose.rotation, t)
    (tmp_path / "near").mkdir()
    model.write_binary(str(tmp_path / "near"))
    with pytest.raises(InputError, match=r"not a model of parallel projection.*px"):
        read_pinhole_model(tmp_path / "near")


def test_folders_without_a_model_are_answered_with_a_sentence(tmp_path) -> None:
    with pytest.raises(InputError, match="holds no COLMAP model"):
        read_pinhole_model(tmp_path)
    (tmp_path / "points3D.bin").write_bytes(b"nonsense")
    with pytest.raises(InputError, match=r"no cameras\.bin"):
        read_pinhole_model(tmp_path)
    empty = tmp_path / "empty"
    empty.mkdir()
    pycolmap.Reconstruction().write_binary(str(empty))
    with pytest.raises(InputError, match="0 registered images"):
        read_pinhole_model(empty)
