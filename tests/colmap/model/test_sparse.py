import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.colmap.database.work import (
    DatabaseImage,
    open_database,
    read_inlier_matches,
    read_matches,
    write_matches,
    write_two_view_geometries,
)
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.points_ply import read_points_ply
from semsfm_colmap.colmap.model.sparse import model_deviation, read_model, write_model
from semsfm_colmap.colmap.model.telecentric import required_focal_length
from semsfm_colmap.colmap.options import ExportOptions
from semsfm_colmap.errors import InputError
from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.types import DepthSign, Reconstruction


@pytest.fixture
def reconstruction():
    s = simulate_tracks(num_images=6, range_deg=60, num_tracks=200, rng=np.random.default_rng(0))
    counter = dict.fromkeys(range(6), 0)
    keypoint_idx = np.empty(len(s.observations), dtype=np.int64)
    for o, i in enumerate(s.observations.image_idx):
        keypoint_idx[o] = counter[i]
        counter[i] += 1
    unit = 0.05
    return Reconstruction(
        image_names=("a b.png", "ü.png", "sub/c.png", "d.png", "e.png", "f.png"),
        image_size_px=np.full((6, 2), (1000, 900)),
        cameras=replace(s.cameras, scale_px_per_unit=s.cameras.scale_px_per_unit / unit),
        points=s.points * unit,
        observations=replace(s.observations, keypoint_idx=keypoint_idx),
        inlier=np.ones(len(s.observations), dtype=bool),
        point_color=np.full((len(s.points), 3), 77, dtype=np.uint8),
        sigma_rotation_rad=np.full((6, 3), 1e-3),
        sigma_translation_px=np.full((6, 2), 0.1),
        sigma_scale=np.full(6, 1e-4),
        world_unit="um",
        pixel_size_um=unit,
        pixel_size_source="test",
        depth_sign=DepthSign(status="resolved", confidence=0.99, evidence={"near side": 0.99}),
        gauge="as simulated",
    )


def write(reconstruction, path, **options):
    images = {
        n: DatabaseImage(image_id=10 + k, name=n, camera_id=1)
        for k, n in enumerate(reconstruction.image_names)
    }
    obs = reconstruction.observations
    keypoints = {n: obs.xy[obs.image_idx == k] for k, n in enumerate(reconstruction.image_names)}
    return write_model(reconstruction, path, images, keypoints, ExportOptions(**options))


@pytest.mark.parametrize("bound", [0.05, 0.005])
def test_the_pinhole_keeps_the_bound_that_is_written_down(reconstruction, tmp_path, bound):
    written = write(reconstruction, tmp_path / "0", max_deviation_px=bound)
    assert 0.0 < written.max_deviation_px <= 1.01 * bound
    model = pycolmap.Reconstruction(str(tmp_path / "0"))
    assert model_deviation(model, reconstruction) == pytest.approx(written.max_deviation_px)
    sidecar = json.loads((tmp_path / "0" / "orthographic.json").read_text())
    assert sidecar["telecentric"]["focal_length_px"] == written.focal_length_px
    assert {c.model_name for c in model.cameras.values()} == {"SIMPLE_PINHOLE"}
    # COLMAP's own reprojection error is that of the orthographic residuals
    r = np.linalg.norm(reconstruction.residuals(), axis=1)
    assert model.compute_mean_reprojection_error() == pytest.approx(r.mean(), abs=bound)


def test_a_model_comes_back_from_disk_as_it_was(reconstruction, tmp_path):
    write(reconstruction, tmp_path / "0")
    back = read_model(tmp_path / "0")
    assert back.image_names == reconstruction.image_names
    for name in ("cam_from_world", "scale_px_per_unit", "translation_px"):
        assert np.array_equal(getattr(back.cameras, name), getattr(reconstruction.cameras, name))
    assert np.array_equal(back.points, reconstruction.points)
    assert np.array_equal(back.observations.xy, reconstruction.observations.xy)
    assert np.array_equal(back.observations.image_idx, reconstruction.observations.image_idx)
    assert back.depth_sign.evidence == {"near side": 0.99}
    assert (back.world_unit, back.pixel_size_um) == ("um", 0.05)
    write(back, tmp_path / "1")
    for name in ("points3D.bin", "images.bin", "cameras.bin", "orthographic.json"):
        assert (tmp_path / "0" / name).read_bytes() == (tmp_path / "1" / name).read_bytes()


def test_the_sidecar_has_every_key_of_its_format(reconstruction, tmp_path):
    write(reconstruction, tmp_path / "0")
    data = json.loads((tmp_path / "0" / "orthographic.json").read_text())
    assert data["format"] == "semsfm-orthographic"
    assert data["version"] == 1
    assert data["pixel_size"] == {"value": 0.05, "unit": "um", "source": "test"}
    assert set(data) >= {"world_unit", "depth_sign", "camera_model", "aspect", "skew", "gauge"}
    assert set(data["depth_sign"]) >= {"status", "evidence", "confidence"}
    image = data["images"]["a b.png"]
    assert set(image) >= {
        "cam_from_world",
        "scale_px_per_unit",
        "translation_px",
        "sigma_rotation_deg",
        "sigma_translation_px",
    }


def test_a_second_write_replaces_the_first_whole(reconstruction, tmp_path):
    write(reconstruction, tmp_path / "0")
    (tmp_path / "0" / "stray").write_text("x")
    write(reconstruction, tmp_path / "0")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["0"]
    assert not (tmp_path / "0" / "stray").exists()


def test_a_damaged_or_foreign_model_is_refused_in_one_sentence(reconstruction, tmp_path):
    with pytest.raises(InputError, match="run `semsfm map`"):
        read_model(tmp_path / "0")
    write(reconstruction, tmp_path / "0")
    (tmp_path / "0" / "orthographic.json").write_text("{")
    with pytest.raises(InputError, match="not valid JSON"):
        read_model(tmp_path / "0")


def test_the_focal_length_grows_with_depth_and_shrinks_with_the_bound(reconstruction):
    obs = reconstruction.observations
    size = reconstruction.image_size_px

    def focal(points, bound):
        return required_focal_length(
            reconstruction.cameras, points[obs.track_idx], obs.image_idx, size / 2, size, bound
        )

    points = np.asarray(reconstruction.points)
    assert focal(points, 0.01) > 2 * focal(points, 0.05)
    assert focal(2 * points, 0.01) > 2 * focal(points, 0.01)
    assert focal(0 * points, 0.01) == 100 * 1000


def test_matches_and_geometries_come_back_from_the_database(tmp_path):
    path = tmp_path / "database.db"
    with open_database(path, create=True) as db:
        camera = db.write_camera(
            pycolmap.Camera(model="SIMPLE_PINHOLE", width=10, height=10, params=[1e4, 5, 5])
        )
        for k in (1, 2, 3):
            db.write_image(pycolmap.Image(name=f"{k}.png", camera_id=camera, image_id=k), True)
    rows = np.array([[0, 1], [2, 3], [4, 5]])
    write_matches(path, {(1, 2): rows, (1, 3): np.zeros((0, 2))})
    assert np.array_equal(read_matches(path)[1, 2], rows)
    F = np.array([[0, 0, 0.5], [0, 0, 0.5], [0.5, 0.5, 1.0]])
    write_two_view_geometries(path, {(1, 2): (F, rows[:2]), (1, 3): (None, rows[:0])})
    assert list(read_inlier_matches(path)) == [(1, 2)]
    assert np.array_equal(read_inlier_matches(path)[1, 2], rows[:2])
    with open_database(path) as db:
        assert np.allclose(db.read_two_view_geometry(1, 2).F, F)
    write_two_view_geometries(path, {(1, 2): (F, rows)})
    assert len(read_inlier_matches(path)[1, 2]) == 3


def test_a_file_that_is_no_database_is_refused_in_one_sentence(tmp_path):
    path = tmp_path / "database.db"
    with pytest.raises(InputError, match="does not exist"), open_database(path):
        pass
    path.write_bytes(b"not a database" * 100)
    with pytest.raises(InputError, match="is not a COLMAP database"):
        read_matches(path)


def test_writing_a_png_after_importing_the_colmap_package_does_not_abort(tmp_path):
    """pycolmap imported before cv2 or PIL makes the process die while writing a PNG."""
    code = (
        "import semsfm_colmap.colmap.model.sparse, numpy, PIL.Image, cv2, sys;"
        "image = numpy.random.default_rng(0).integers(0, 255, (400, 400), dtype='uint8');"
        "PIL.Image.fromarray(image).save(sys.argv[1] + '/a.png');"
        "assert cv2.imwrite(sys.argv[1] + '/b.png', image)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True)
    assert done.returncode == 0, done.stderr.decode()
    assert (tmp_path / "b.png").stat().st_size > 10_000


def test_error_bars_of_the_points_stand_in_the_ply_and_come_back(reconstruction, tmp_path):
    rng = np.random.default_rng(1)
    root = 0.01 * rng.normal(size=(len(reconstruction.points), 3, 3))
    covariance = root @ root.transpose(0, 2, 1)
    covariance[5] = np.nan
    write(replace(reconstruction, point_covariance=covariance), tmp_path / "0")
    rows = read_points_ply(tmp_path / "0" / "points.ply")
    assert np.array_equal(rows["x"], reconstruction.points[:, 0])
    assert np.allclose(rows["sigma_z"], np.sqrt(covariance[:, 2, 2]), equal_nan=True)
    assert np.array_equal(rows["num_observations"], reconstruction.track_length())
    back = read_model(tmp_path / "0")
    assert np.allclose(back.point_covariance, covariance, rtol=1e-5, atol=1e-12, equal_nan=True)
    # a model whose points another program moved keeps none of ours
    model = pycolmap.Reconstruction(str(tmp_path / "0"))
    first = min(model.points3D)
    model.points3D[first].xyz = model.points3D[first].xyz + 1.0
    model.write_binary(str(tmp_path / "0"))
    assert read_model(tmp_path / "0").point_covariance is None


def test_other_programs_read_the_points_ply(reconstruction, tmp_path):
    open3d = pytest.importorskip("open3d")
    write(reconstruction, tmp_path / "0")
    cloud = open3d.io.read_point_cloud(str(tmp_path / "0" / "points.ply"))
    assert np.allclose(np.asarray(cloud.points), reconstruction.points)
    assert np.allclose(np.asarray(cloud.colors) * 255, 77)


def test_how_far_to_trust_the_model_is_added_to_the_sidecar(reconstruction, tmp_path):
    write(reconstruction, tmp_path / "0")
    plain = json.loads((tmp_path / "0" / "orthographic.json").read_text())
    assert "reliability" not in plain
    images = {
        n: DatabaseImage(image_id=10 + k, name=n, camera_id=1)
        for k, n in enumerate(reconstruction.image_names)
    }
    obs = reconstruction.observations
    keypoints = {n: obs.xy[obs.image_idx == k] for k, n in enumerate(reconstruction.image_names)}
    said = {"total_rotation_deg": 60.0, "total_rotation_sigma_deg": 0.1}
    write_model(
        reconstruction, tmp_path / "1", images, keypoints, ExportOptions(), reliability=said
    )
    data = json.loads((tmp_path / "1" / "orthographic.json").read_text())
    assert data.pop("reliability") == said
    assert data == plain


def test_another_aspect_is_a_pinhole_of_two_focal_lengths_within_the_bound(
    reconstruction, tmp_path
):
    stretched = replace(reconstruction, cameras=replace(reconstruction.cameras, aspect=1.01))
    written = write(stretched, tmp_path / "0", max_deviation_px=0.02)
    assert written.max_deviation_px <= 1.01 * 0.02
    model = pycolmap.Reconstruction(str(tmp_path / "0"))
    (camera,) = model.cameras.values()
    assert camera.model_name == "PINHOLE"
    assert camera.focal_length_y / camera.focal_length_x == pytest.approx(1.01)


def test_skew_which_colmap_cannot_hold_is_written_with_the_deviation_it_leaves(
    reconstruction, tmp_path
):
    skewed = replace(reconstruction, cameras=replace(reconstruction.cameras, skew=0.003))
    written = write(skewed, tmp_path / "0", max_deviation_px=0.02)
    sidecar = json.loads((tmp_path / "0" / "orthographic.json").read_text())
    assert sidecar["telecentric"]["max_deviation_px"] == written.max_deviation_px > 0.1
    assert sidecar["skew"] == 0.003
