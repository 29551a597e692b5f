from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imodmodel import ImodModel
from PIL import Image

from semsfm_colmap.errors import InputError
from semsfm_colmap.exports.formats import aretomo, imod, relion_star
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene
from semsfm_colmap.exports.tilt_series import tilt_series
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.ingest.files.listing import find_images
from semsfm_colmap.ingest.files.raster import read_header, read_pixels
from semsfm_colmap.io.grey import read_grey
from semsfm_colmap.types import (
    Observations,
    OrthographicCameras,
    Reconstruction,
    SemFrame,
    SemMetadata,
    SemSeries,
)
from tests.oracles import tilt_series as oracle

SIZE = (160, 120)
STEPS = 13
ROUND_TRIP_PX = 0.01


def scene(
    folder: Path,
    *,
    axis_deg: float = 97.0,
    wobble_deg: float = 0.0,
    out_of_plane_deg: float = 0.0,
    drift: float = 0.0,
    aspect: float = 1.0,
    skew: float = 0.0,
    noise_px: float = 0.0,
    range_deg: float = 120.0,
    tilt_rad: np.ndarray | None = None,
) -> ExportScene:
    """A random cloud that turns about an axis at `axis_deg` from x toward y in the images."""
    rng = np.random.default_rng(5)
    phi, b = np.radians([axis_deg, out_of_plane_deg])
    axis = np.array([np.cos(b) * np.cos(phi), np.cos(b) * np.sin(phi), np.sin(b)])
    angle = np.radians(np.linspace(0.0, range_deg, STEPS))
    wobble = np.radians(wobble_deg) * rng.normal(size=(STEPS, 3))
    start = rotation_from_vector(np.array([0.4, -0.3, 0.2]))
    R = rotation_from_vector(wobble) @ rotation_from_vector(angle[:, None] * axis) @ start
    points = rng.uniform(-1.2, 1.2, (80, 3)) + np.array([3.0, -2.0, 5.0])
    cameras = OrthographicCameras(
        cam_from_world=R,
        scale_px_per_unit=20.0 * np.exp(drift * rng.normal(size=STEPS)),
        translation_px=np.array(SIZE) / 2.0 + rng.normal(scale=5.0, size=(STEPS, 2)),
        aspect=aspect,
        skew=skew,
    )
    track, image = np.nonzero(rng.random((len(points), STEPS)) < 0.8)
    xy = cameras.project(points[track], image)
    observations = Observations(
        image_idx=image, track_idx=track, keypoint_idx=np.zeros(len(track), np.int64),
        xy=xy + noise_px * rng.normal(size=xy.shape), num_images=STEPS, num_tracks=len(points),
    )  # fmt: skip
    names = tuple(f"{k:02d}.png" for k in range(STEPS))
    reconstruction = Reconstruction(
        image_names=names,
        image_size_px=np.tile(SIZE, (STEPS, 1)),
        cameras=cameras,
        points=points,
        observations=observations,
        inlier=np.ones(len(track), dtype=bool),
        world_unit="um",
        pixel_size_um=0.05,
    )
    (folder / "images").mkdir(exist_ok=True)
    for name in names:
        grey = rng.integers(0, 255, SIZE[::-1], dtype=np.uint8)
        Image.fromarray(grey).save(folder / "images" / name)
    return ExportScene(
        reconstruction=reconstruction, names=names, image_ids=(), keypoints=(),
        focal_length_px=1e6, image_path=folder / "images", tilt_rad=tilt_rad,
    )  # fmt: skip


def write(module, made: ExportScene, folder: Path):
    folder.mkdir()
    return module.write(made, folder, FormatOptions())


def gap_px(made: ExportScene, views: list[oracle.View], summary) -> np.ndarray:
    """Distance of what a reader of the files sees to what the cameras see: (O,)."""
    to_tomogram = np.array(summary["tomogram_px_from_world"])
    X = made.reconstruction.points @ to_tomogram[:, :3].T + to_tomogram[:, 3]
    obs = made.reconstruction.observations
    found = []
    for i, j in zip(obs.image_idx, obs.track_idx, strict=True):
        q = views[i].L @ X[j] + views[i].q0
        found.append([q[0] + SIZE[0] / 2, SIZE[1] / 2 - q[1]])
    ours = made.reconstruction.cameras.project(
        made.reconstruction.points[obs.track_idx], obs.image_idx
    )
    return np.linalg.norm(np.array(found) - ours, axis=1)


GENERAL = {"wobble_deg": 1.0, "out_of_plane_deg": 3.0, "drift": 0.01}


@pytest.mark.parametrize("axis_deg", [-170.0, -91.0, -30.0, 0.0, 60.0, 90.0, 135.0])
def test_a_clean_series_is_held_by_every_format(tmp_path, axis_deg) -> None:
    made = scene(tmp_path, axis_deg=axis_deg)
    folders = {name: tmp_path / name for name in ("imod", "aretomo", "relion")}
    summaries = [
        write(module, made, folders[name])
        for name, module in zip(folders, (imod, aretomo, relion_star), strict=True)
    ]
    views = [
        oracle.imod_views(folders["imod"]),
        oracle.aretomo_views(folders["aretomo"] / "series.aln"),
        oracle.relion_views(folders["relion"]),
    ]
    for summary, seen in zip(summaries, views, strict=True):
        assert gap_px(made, seen, summary).max() < ROUND_TRIP_PX
        assert summary["max_deviation_px"] < 1e-9


@pytest.mark.parametrize("distortion", [{}, {"aspect": 1.02, "skew": 0.01}])
def test_the_files_with_x_tilt_hold_any_rotation_and_magnification(tmp_path, distortion) -> None:
    made = scene(tmp_path, **GENERAL, **distortion)
    summary = write(imod, made, tmp_path / "out")
    views = oracle.imod_views(tmp_path / "out" / "xtilt")
    assert gap_px(made, views, summary).max() < ROUND_TRIP_PX


def test_what_a_format_does_not_hold_is_said_with_its_size(tmp_path) -> None:
    made = scene(tmp_path, **GENERAL)
    for name, module in (("imod", imod), ("aretomo", aretomo), ("relion", relion_star)):
        folder = tmp_path / name
        summary = write(module, made, folder)
        read = {
            "imod": oracle.imod_views,
            "aretomo": lambda path: oracle.aretomo_views(path / "series.aln"),
            "relion": oracle.relion_views,
        }[name]
        gap = gap_px(made, read(folder), summary)
        assert gap.max() > 0.3
        assert gap.max() == pytest.approx(summary["max_deviation_px"], abs=ROUND_TRIP_PX)
        rms = float(np.sqrt(np.mean(gap**2)))
        assert rms == pytest.approx(summary["rms_deviation_px"], abs=ROUND_TRIP_PX)
        assert f"{rms:.2g} px RMS" in summary["notes"][0]
        table = np.genfromtxt(folder / "views.csv", delimiter=",", names=True, usecols=range(2, 10))
        image = made.reconstruction.observations.image_idx
        for k in range(STEPS):
            expected = np.sqrt(np.mean(gap[image == k] ** 2))
            assert table["not_held_px"][k] == pytest.approx(expected, abs=ROUND_TRIP_PX)


def test_fiducials_lie_on_straight_sinusoids_in_the_aligned_stack(tmp_path) -> None:
    made = scene(tmp_path, noise_px=0.2, drift=0.01)
    summary = write(imod, made, tmp_path / "out")
    tracks = oracle.imod_aligned_fiducials(tmp_path / "out", SIZE)
    assert len(tracks) == summary["num_fiducials"] == 80
    rms = float(np.sqrt(np.mean(oracle.sinusoid_residuals(tracks) ** 2)))
    assert 0.2 < rms < 0.3  # noise in x and y, less the three parameters of each track


def test_fiducials_agree_with_the_x_tilts_where_one_axis_is_not_enough(tmp_path) -> None:
    made = scene(tmp_path, noise_px=0.2, wobble_deg=3.0, drift=0.01)
    write(imod, made, tmp_path / "out")
    rms = []
    for folder in (tmp_path / "out", tmp_path / "out" / "xtilt"):
        views = oracle.imod_views(folder)
        left = oracle.fiducial_residuals(tmp_path / "out", views, SIZE)
        rms.append(float(np.sqrt(np.mean(left**2))))
    assert rms[0] > 0.4
    assert 0.2 < rms[1] < 0.3


def test_a_conical_axis_is_absorbed_as_far_as_a_plane_of_directions_can(tmp_path) -> None:
    """Over 40 degrees an axis 1 degree out of the plane costs a tenth of what it does unfitted."""
    made = scene(tmp_path, out_of_plane_deg=1.0, range_deg=40.0)
    series = tilt_series(made)
    assert np.abs(np.degrees(series.out_of_plane_rad)).max() < 0.1
    assert np.ptp(np.degrees(series.rotation_rad)) > 0.3


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_tilts_have_the_sense_and_zero_of_the_recorded_ones(tmp_path, sign) -> None:
    recorded = np.radians(sign * np.linspace(-70.0, 50.0, STEPS))
    recorded[4] = np.nan
    series = tilt_series(scene(tmp_path, tilt_rad=recorded))
    expected = sign * np.linspace(-70.0, 50.0, STEPS)
    np.testing.assert_allclose(np.degrees(series.tilt_rad), expected, atol=1e-6)


def test_without_recorded_tilts_the_axis_points_up_and_zero_is_the_middle(tmp_path) -> None:
    for axis_deg, rotation_deg in ((80.0, 10.0), (100.0, -10.0), (-80.0, -10.0), (5.0, -95.0)):
        series = tilt_series(scene(tmp_path, axis_deg=axis_deg))
        np.testing.assert_allclose(np.degrees(series.rotation_rad), rotation_deg, atol=1e-6)
        assert np.degrees(np.abs(series.tilt_rad)).max() == pytest.approx(60.0)


def test_the_tomogram_of_a_lying_axis_is_as_high_as_the_images_are_wide(tmp_path) -> None:
    for axis_deg, size in ((80.0, (160, 120)), (10.0, (120, 160)), (-170.0, (120, 160))):
        series = tilt_series(scene(tmp_path, axis_deg=axis_deg))
        width, height, depth = series.tomogram_size_px
        assert (width, height) == size
        assert 1.0 < depth / (2.0 * np.abs(series.points_px[:, 2]).max()) < 1.3


def test_a_full_turn_is_unwrapped(tmp_path) -> None:
    series = tilt_series(scene(tmp_path, range_deg=350.0, wobble_deg=0.3))
    steps = np.abs(np.diff(np.degrees(series.tilt_rad)))
    assert steps.min() > 27.0
    assert steps.max() < 31.0


def test_x_tilts_stay_small_beyond_90_degrees(tmp_path) -> None:
    made = scene(tmp_path, range_deg=350.0, out_of_plane_deg=0.5)
    write(imod, made, tmp_path / "out")
    x_tilt, tilt = (
        np.loadtxt(tmp_path / "out/xtilt" / f"series.{kind}") for kind in ("xtilt", "tlt")
    )
    assert 0.4 < np.abs(x_tilt).max() < 0.6 / np.abs(np.cos(np.radians(tilt))).min()
    single = np.loadtxt(tmp_path / "out" / "series.tlt")
    np.testing.assert_allclose(tilt, single, atol=0.1)


def test_the_stack_holds_the_images_lowest_row_first_and_is_read_back_as_they_are(tmp_path) -> None:
    made = scene(tmp_path)
    write(imod, made, tmp_path / "out")
    stack = tmp_path / "out" / "series.st"
    sections, angstrom = oracle.read_mrc(stack)
    scale = float(np.exp(np.mean(np.log(made.reconstruction.cameras.scale_px_per_unit))))
    assert angstrom == pytest.approx(1e4 / scale, rel=1e-6)
    for k, name in enumerate(find_images(stack).names):
        image = read_grey(made.image_path / made.names[k])
        np.testing.assert_array_equal(sections[k], image[::-1])
        back = read_pixels(stack / name, read_header(stack / name, 10**6)).pixels
        np.testing.assert_array_equal(back, image.astype(int) - image.min())


def test_the_table_of_views_is_that_of_tiltalign(tmp_path) -> None:
    recorded = np.radians(np.linspace(-60.0, 60.0, STEPS) + 0.3 * (-1.0) ** np.arange(STEPS))
    made = scene(tmp_path, noise_px=0.2, drift=0.01, tilt_rad=recorded)
    write(imod, made, tmp_path / "out")
    lines = (tmp_path / "out" / "taSolution.log").read_text().splitlines()
    head = lines[2].split()
    assert head == ["view", "rotation", "tilt", "deltilt", "mag", "dmag", "skew", "resid-nm"]
    rows = np.array([[float(word) for word in line.split()] for line in lines[3:]])
    table = np.genfromtxt(
        tmp_path / "out" / "views.csv", delimiter=",", names=True, usecols=range(2, 10)
    )
    np.testing.assert_allclose(rows[:, 3], rows[:, 2] - np.degrees(recorded), atol=0.011)
    np.testing.assert_allclose(rows[:, 4], table["magnification"], atol=1e-4)
    nm_per_px = 1e3 / 20.0
    np.testing.assert_allclose(rows[:, 7], nm_per_px * table["residual_px"], rtol=0.02)
    assert (table["leave_out_px"] > table["residual_px"]).all()
    rawtlt = np.loadtxt(tmp_path / "out" / "series.rawtlt")
    np.testing.assert_allclose(rawtlt, np.degrees(recorded), atol=1e-5)


def test_recorded_tilts_come_from_the_series_by_name() -> None:
    frames = tuple(
        SemFrame(
            name=name, width_px=1, height_px=1, source_path="", crop_px=(0, 0, 1, 1),
            metadata=SemMetadata(tilt_rad=tilt),
        )
        for name, tilt in (("a", 0.1), ("b", None), ("c", 0.3))
    )  # fmt: skip
    found = SemSeries(frames=frames).recorded("tilt_rad", ["c", "b", "x"])
    np.testing.assert_array_equal(found, [0.3, np.nan, np.nan])


def test_images_of_several_sizes_are_refused(tmp_path) -> None:
    made = scene(tmp_path)
    sizes = np.array(made.reconstruction.image_size_px)
    sizes[3] = 150, 120
    other = replace(made, reconstruction=replace(made.reconstruction, image_size_px=sizes))
    with pytest.raises(InputError, match=r"several sizes \(150 x 120, 160 x 120\)"):
        tilt_series(other)


def test_a_series_that_does_not_tilt_is_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="viewing directions hardly differ"):
        tilt_series(scene(tmp_path, range_deg=0.5))
    with pytest.raises(InputError, match="viewing directions hardly differ"):
        tilt_series(scene(tmp_path, out_of_plane_deg=90.0))  # it turns in the image plane


def test_a_cone_of_directions_is_refused(tmp_path) -> None:
    with pytest.raises(InputError, match=r"leave a plane by up to \d\d degrees"):
        tilt_series(scene(tmp_path, out_of_plane_deg=40.0, range_deg=330.0))


def test_relion_needs_a_pixel_size(tmp_path) -> None:
    made = scene(tmp_path)
    in_px = replace(made, reconstruction=replace(made.reconstruction, world_unit="px"))
    with pytest.raises(InputError, match="give --pixel_size_um"):
        write(relion_star, in_px, tmp_path / "out")
    shutil.rmtree(tmp_path / "out")
    write(imod, in_px, tmp_path / "out")
    assert oracle.read_mrc(tmp_path / "out" / "series.st")[1] == 0.0
    assert "mean resid" in (tmp_path / "out" / "taSolution.log").read_text()


def test_the_fiducial_model_is_what_an_independent_reader_of_imods_format_finds(tmp_path) -> None:
    """imodmodel reads after IMOD's description; nothing is left over before the end mark."""
    made = scene(tmp_path, noise_px=0.2)
    write(imod, made, tmp_path / "out")
    path = tmp_path / "out" / "series.fid"
    model = ImodModel.from_file(path)
    header = model.header
    assert (header.xmax, header.ymax, header.zmax) == (*SIZE, STEPS)
    assert (header.xscale, header.yscale, header.zscale, header.pixelsize) == (1.0, 1.0, 1.0, 1.0)
    (tracks,) = model.objects
    assert int(tracks.header.flags) == 1 << 3  # open
    table = np.loadtxt(tmp_path / "out" / "fiducials.txt")
    assert len(tracks.contours) == tracks.header.contsize == int(table[:, 1].max())
    for number, contour in enumerate(tracks.contours, start=1):
        np.testing.assert_allclose(contour.points, table[table[:, 1] == number, 2:], atol=1e-4)
    content = path.read_bytes()
    assert len(content) == 240 + 180 + 20 * len(tracks.contours) + 12 * len(table) + 4
    assert content.endswith(b"IEOF")
