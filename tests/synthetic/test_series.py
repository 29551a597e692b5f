"""A whole series on disk: layout, truth, determinism, and that the images show the specimen."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

from semsfm_colmap.errors import UsageError
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.io.open3d_rays import ray_scene, ray_tensor
from semsfm_colmap.synthetic import SynthesizeOptions, example_options, synthesize
from semsfm_colmap.synthetic.detector import MEDIAN_GREY
from semsfm_colmap.types import Array

SMALL = SynthesizeOptions(
    num_images=3,
    step_deg=6.0,
    width_px=160,
    height_px=152,
    databar_rows=24,
    mesh_edge_px=2.0,
    supersampling=1,
    # Deep cavities can be as dark as the empty chamber: the tests tell specimen from chamber.
    cavity_strength=0.3,
)
SHARED = Path(__file__).parents[2] / "../shared/data"


def read_truth(path: Path) -> dict[str, Any]:
    return dict(json.loads((path / "truth.json").read_text()))


def read_image(path: Path) -> Array:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return np.asarray(image)


@pytest.fixture(scope="module")
def grain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("grain")
    synthesize(path, SMALL)
    return path


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("field")
    options = replace(
        SMALL,
        scene="field",
        step_deg=None,
        range_deg=100.0,
        image_format="tif",
        counts=0.0,
        gain_change=0.0,
    )
    synthesize(path, options)
    return path


@pytest.fixture(scope="module")
def clump(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("clump")
    synthesize(path, replace(SMALL, scene="clump", num_images=5, step_deg=40.0, databar=False))
    return path


def test_the_folder_holds_images_truth_and_surface(grain: Path) -> None:
    files = sorted(str(p.relative_to(grain)) for p in grain.rglob("*") if p.is_file())
    images = [f"images/grain_00{i}.png" for i in range(3)]
    assert files == [*images, "mesh.npz", "truth.json", "truth.npz"]
    for name in images:
        assert read_image(grain / name).shape == (152, 160)
        assert read_image(grain / name).dtype == np.uint8


def test_the_same_seed_gives_the_same_bytes_and_another_seed_another_series(
    grain: Path, tmp_path: Path
) -> None:
    synthesize(tmp_path / "again", SMALL)
    synthesize(tmp_path / "other", replace(SMALL, seed=8))
    for file in sorted(p for p in grain.rglob("*") if p.is_file()):
        name = file.relative_to(grain)
        assert (tmp_path / "again" / name).read_bytes() == file.read_bytes(), name
        assert (tmp_path / "other" / name).read_bytes() != file.read_bytes(), name


def test_a_change_of_the_noise_leaves_motion_and_specimen_as_they_were(
    grain: Path, tmp_path: Path
) -> None:
    synthesize(tmp_path, replace(SMALL, counts=50.0))
    assert (tmp_path / "mesh.npz").read_bytes() == (grain / "mesh.npz").read_bytes()
    assert (tmp_path / "truth.npz").read_bytes() == (grain / "truth.npz").read_bytes()


def test_json_and_npz_hold_the_same_cameras(grain: Path) -> None:
    truth = read_truth(grain)
    with np.load(grain / "truth.npz") as stored:
        for key in ("R", "t", "scale", "nominal_deg", "true_deg"):
            np.testing.assert_array_equal(stored[key], [f[key] for f in truth["frames"]])
        np.testing.assert_array_equal(stored["axis"], truth["rotation_axis_cam"])
        assert stored["row_jitter_px"].shape == (3, 128)


def test_the_rotations_are_the_true_angles_about_the_axis_within_the_wobble(grain: Path) -> None:
    truth = read_truth(grain)
    axis = np.array(truth["rotation_axis_cam"])
    for frame in truth["frames"]:
        turn = rotation_from_vector(np.radians(frame["true_deg"]) * axis)
        wobble_deg = np.degrees(np.abs(np.array(frame["R"]) @ turn.T - np.eye(3)).max())
        assert 0.0 < wobble_deg < 5 * SMALL.wobble_deg
        assert abs(frame["true_deg"] - frame["nominal_deg"]) < 5 * SMALL.step_error_deg


def test_the_pixel_size_follows_from_unit_and_scale(grain: Path) -> None:
    truth = read_truth(grain)
    mean_scale = np.mean([f["scale"] for f in truth["frames"]])
    assert truth["pixel_size_um"] == pytest.approx(truth["unit_um"] / mean_scale)
    # A grain of 30 um across in an image of 128 rows.
    assert 0.2 < truth["pixel_size_um"] < 0.6


@pytest.mark.parametrize("scene", ["grain", "field", "clump"])
def test_the_images_are_bright_where_rays_of_the_true_cameras_hit_the_true_surface(
    scene: str, request: pytest.FixtureRequest
) -> None:
    path = request.getfixturevalue(scene)
    truth = read_truth(path)
    with np.load(path / "mesh.npz") as mesh:
        caster = ray_scene(mesh["vertices"], mesh["faces"])
    x0, y0, x1, y1 = truth["image_area"]
    v, u = np.mgrid[y0:y1, x0:x1] + 0.5
    for frame in truth["frames"]:
        image = read_image(path / "images" / frame["name"])[y0:y1, x0:x1]
        R = np.array(frame["R"])
        xy = (np.stack([u, v], axis=-1).reshape(-1, 2) - frame["t"]) / frame["scale"]
        origin = xy @ R[:2] - 9.0 * R[2]
        hit = caster.cast_rays(ray_tensor(origin, np.tile(R[2], (len(origin), 1))))
        on = np.isfinite(hit["t_hit"].numpy()).reshape(image.shape)
        # Away from the outline, where beam and scan blur it.
        kernel = np.ones((7, 7), np.uint8)
        inside = cv2.erode(on.astype(np.uint8), kernel) > 0
        outside = cv2.dilate(on.astype(np.uint8), kernel) == 0
        assert np.mean(image[inside] > 35) > 0.99
        if outside.any():
            assert np.mean(image[outside] < 30) > 0.99


def test_the_field_fills_every_frame(field: Path) -> None:
    # Without noise the empty chamber has a grey value of about 255 BACKGROUND = 11.
    for file in sorted((field / "images").iterdir()):
        assert tifffile.imread(file)[:128].min() > 20


def test_the_exposure_is_that_of_the_series_so_that_tilt_shows_as_brightness(field: Path) -> None:
    tilted, flat, _ = (
        np.median(tifffile.imread(file)[:128]) for file in sorted((field / "images").iterdir())
    )
    # The first image, at 50 degrees, is exposed to middle grey, to within what the beam profile
    # makes of the median; the flat one stays below it.
    assert abs(tilted / 255.0 - MEDIAN_GREY) < 0.04
    assert flat < 0.9 * tilted


def test_stalk_and_ribbon_leave_the_image_and_the_specimen_does_not(
    grain: Path, clump: Path
) -> None:
    for file in sorted((grain / "images").iterdir()):
        image = read_image(file)[:128]
        assert image[-1].max() > 60
        assert max(image[0].max(), image[:, 0].max(), image[:, -1].max()) < 60
    for file in sorted((clump / "images").iterdir()):
        image = read_image(file)
        assert image[:, -1].max() > 60
        assert max(image[0].max(), image[-1].max(), image[:, 0].max()) < 60


def test_the_databar_is_static_but_for_its_readings_and_the_image_is_not(grain: Path) -> None:
    first, second = (read_image(grain / "images" / f"grain_00{i}.png") for i in (0, 1))
    same = first == second
    assert 0.9 < same[128:].mean() < 1.0
    assert same[:128].mean() < 0.3


def test_without_a_databar_the_whole_frame_is_image(clump: Path) -> None:
    truth = read_truth(clump)
    assert truth["databar_rows"] == 0
    assert truth["image_area"] == [0, 0, 160, 152]


def test_only_the_clump_records_a_displacement_for_each_image(grain: Path, clump: Path) -> None:
    with (clump / "displacement.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["image"] for row in rows] == [f["name"] for f in read_truth(clump)["frames"]]
    turned = np.array([f["true_deg"] for f in read_truth(clump)["frames"]])
    moved = np.array([float(row["displacement_um"]) for row in rows])
    np.testing.assert_allclose(moved * 171.3, turned, atol=5 * 0.001 * 171.3)
    assert not (grain / "displacement.csv").exists()


def test_the_ribbon_and_the_stalk_are_labelled(grain: Path, clump: Path) -> None:
    for path in (grain, clump):
        with np.load(path / "mesh.npz") as mesh:
            label = mesh["vertex_label"]
            assert set(np.unique(label)) == {0, 1}
            assert len(label) == len(mesh["vertices"])
    with np.load(clump / "mesh.npz") as mesh:
        assert mesh["vertices"][mesh["vertex_label"] == 1, 0].min() > -0.2


def test_a_tiff_carries_the_header_of_a_zeiss_microscope(field: Path) -> None:
    truth = read_truth(field)
    for frame in truth["frames"]:
        with tifffile.TiffFile(field / "images" / frame["name"]) as tif:
            header = tif.pages[0].tags[34118].value
        _, value, unit = header["ap_image_pixel_size"]
        assert unit == "nm"
        assert value / 1000.0 == pytest.approx(truth["pixel_size_um"], rel=1e-3)
        _, tilt, _ = header["ap_stage_at_t"]
        assert tilt == pytest.approx(frame["nominal_deg"], abs=0.05)
        _, width, unit = header["ap_width"]
        assert unit == "µm"
        assert width == pytest.approx(160 * truth["pixel_size_um"], rel=1e-3)


def test_the_header_can_be_left_out(tmp_path: Path) -> None:
    options = replace(SMALL, num_images=1, image_format="tif", zeiss_header=False)
    with tifffile.TiffFile(synthesize(tmp_path, options) / "grain_000.tif") as tif:
        assert 34118 not in tif.pages[0].tags


def test_progress_is_told_after_every_image(tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    synthesize(tmp_path, SMALL, progress=lambda done, of: calls.append((done, of)))
    assert calls == [(1, 3), (2, 3), (3, 3)]


def test_images_of_another_run_are_not_overwritten(grain: Path) -> None:
    with pytest.raises(UsageError, match="not empty"):
        synthesize(grain, SMALL)


def test_a_field_that_would_be_seen_from_the_side_is_refused(tmp_path: Path) -> None:
    options = replace(SMALL, scene="field", step_deg=None, range_deg=150.0)
    with pytest.raises(UsageError, match="range_deg"):
        synthesize(tmp_path, options)


def test_no_rays_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"supersampling .* 1 or more"):
        synthesize(tmp_path, replace(SMALL, supersampling=0))


def test_importing_the_package_loads_nothing_heavy() -> None:
    heavy = ["open3d", "cv2", "scipy", "tifffile", "matplotlib"]
    code = f"import sys, semsfm_colmap.synthetic; print([m for m in {heavy} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


@pytest.mark.data
@pytest.mark.parametrize("name", ["synth_pollen", "synth_nickel", "synth_spore"])
def test_the_layout_is_that_of_the_development_series(name: str, grain: Path) -> None:
    if not (SHARED / name).is_dir():
        pytest.skip("development data not beside the repository")
    ours, theirs = read_truth(grain), read_truth(SHARED / name)
    assert set(theirs) <= set(ours)
    assert set(theirs["frames"][0]) <= set(ours["frames"][0])
    assert set(theirs["frames"][0]["nuisance"]) <= set(ours["frames"][0]["nuisance"])
    for file in ("truth.npz", "mesh.npz"):
        with np.load(grain / file) as a, np.load(SHARED / name / file) as b:
            assert set(b) <= set(a)


@pytest.mark.slow
def test_consecutive_images_of_the_example_share_hundreds_of_true_features(
    tmp_path: Path,
) -> None:
    # The cost is in the specimen: two images of the example tell as much as all of them.
    synthesize(tmp_path, replace(example_options(), num_images=2))
    truth = read_truth(tmp_path)
    sift = cv2.SIFT.create(contrastThreshold=0.01)
    found = []
    for frame in truth["frames"]:
        image = read_image(tmp_path / "images" / frame["name"])[:480]
        keypoints, descriptors = sift.detectAndCompute(image, None)
        found.append((np.array([k.pt for k in keypoints]) + 0.5, descriptors))
    (xy1, d1), (xy2, d2) = found
    matches = cv2.BFMatcher(cv2.NORM_L2).knnMatch(d1, d2, k=2)
    pairs = [(a.queryIdx, a.trainIdx) for a, b in matches if a.distance < 0.8 * b.distance]
    i, j = np.array(pairs).T
    R, S = (np.array(frame["R"]) for frame in truth["frames"])
    first, second = truth["frames"]
    origin = (xy1[i] - first["t"]) / first["scale"] @ R[:2] - 9.0 * R[2]
    with np.load(tmp_path / "mesh.npz") as mesh:
        caster = ray_scene(mesh["vertices"], mesh["faces"])
    away = caster.cast_rays(ray_tensor(origin, np.tile(R[2], (len(i), 1))))["t_hit"].numpy()
    hit = np.isfinite(away)
    X = origin[hit] + away[hit, None] * R[2]
    predicted = second["scale"] * X @ S[:2].T + second["t"]
    true = np.linalg.norm(predicted - xy2[j[hit]], axis=1) < 2.0
    assert true.sum() > 500
    assert true.sum() > 0.8 * len(i)
