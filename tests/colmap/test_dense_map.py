"""COLMAP's map files against pycolmap, and depth maps moved onto a pinhole's rays."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.colmap.dense_map import pinhole_depth, read_map, write_map
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.errors import InputError, UsageError
from tests.exports.readers import read_colmap_map


@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3)])
def test_maps_are_what_colmap_s_own_script_reads(tmp_path, shape) -> None:
    values = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    write_map(tmp_path / "ours.bin", values)
    assert np.array_equal(read_colmap_map(tmp_path / "ours.bin"), values)
    assert [p.name for p in tmp_path.iterdir()] == ["ours.bin"]


def test_depth_maps_are_those_of_pycolmap(tmp_path) -> None:
    """Depth only: the normals of pycolmap 4.2's numpy bindings are not in COLMAP's order."""
    values = np.random.default_rng(0).normal(size=(5, 7)).astype(np.float32)
    write_map(tmp_path / "ours.bin", values)
    pycolmap.DepthMap.from_array(values, 0.0, 1.0).write(str(tmp_path / "theirs.bin"))
    assert (tmp_path / "ours.bin").read_bytes() == (tmp_path / "theirs.bin").read_bytes()


def test_what_is_no_map_is_refused(tmp_path) -> None:
    with pytest.raises(UsageError):
        write_map(tmp_path / "b.bin", np.ones(3))


@pytest.mark.parametrize("focal_factor", [30.0, 300.0])
@pytest.mark.parametrize("shrink", [1.0, 0.5])
def test_a_tilted_plane_comes_back_where_it_is(focal_factor, shrink) -> None:
    """The consumer's pixel (row, col) is the image point (col, row): its rays meet our plane."""
    W, H, s = 160, 120, 20.0
    c = np.array([W, H]) / 2.0
    t = np.array([70.0, 65.0])
    w, h = int(W * shrink), int(H * shrink)
    scaling = np.array([w / W, h / H])
    a, b, z0 = 0.7, -0.4, 0.3  # z = z0 + a x + b y in the camera frame
    col, row = np.meshgrid(np.arange(w), np.arange(h))
    x = ((col + 0.5) / scaling[0] - t[0]) / s
    y = ((row + 0.5) / scaling[1] - t[1]) / s
    z = z0 + a * x + b * y
    slope = np.stack([np.full_like(z, a / s / scaling[0]), np.full_like(z, b / s / scaling[1])])
    f = focal_factor * W
    distance = f / s
    depth = pinhole_depth(
        z,
        slope,
        scaling=scaling,
        scale_px_per_unit=s,
        focal_px=f,
        distance=distance,
        principal_point_px=c,
    ).astype(np.float64)
    # a pinhole at T = ((t - c) / s, f / s): what the consumer computes
    T = np.array([*(t - c) / s, distance])
    X = np.stack(
        [
            (col / scaling[0] - c[0]) / f * depth - T[0],
            (row / scaling[1] - c[1]) / f * depth - T[1],
            depth - T[2],
        ]
    )
    gap_px = np.abs(X[2] - (z0 + a * X[0] + b * X[1])) * s
    # float32 at this distance, and the second order of the shift
    assert gap_px.max() < 4 * f * 2.0**-24 + 0.06 * (30.0 / focal_factor) ** 2
    naive_px = np.abs(z - (z0 + a * X[0] + b * X[1])) * s
    assert naive_px.max() > 5 * gap_px.max()


def test_unknown_pixels_stay_unknown() -> None:
    z = np.zeros((3, 4), dtype=np.float32)
    z[1, 2] = np.nan
    slope = np.zeros((2, 3, 4))
    slope[0, 0, 0] = np.nan
    depth = pinhole_depth(
        z,
        slope,
        scaling=np.ones(2),
        scale_px_per_unit=1.0,
        focal_px=100.0,
        distance=100.0,
        principal_point_px=np.array([2.0, 1.5]),
    )
    assert depth.dtype == np.float32
    assert (depth == 0).sum() == 2
    assert depth[1, 2] == depth[0, 0] == 0


@pytest.mark.parametrize("shape", [(3, 5), (4, 2, 3)])
def test_a_map_is_read_as_it_was_written(shape, tmp_path):
    values = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    write_map(tmp_path / "m.bin", values)
    np.testing.assert_array_equal(read_map(tmp_path / "m.bin"), values)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "its head is missing"),
        (b"5&4&1", "its head is missing"),
        (b"a&4&1&" + bytes(80), "its head is missing"),
        (b"5&4&1&" + bytes(79), "cut short"),
        (b"0&4&1&", "cut short"),
    ],
)
def test_a_file_that_is_no_map_is_one_sentence(content, words, tmp_path):
    (tmp_path / "m.bin").write_bytes(content)
    with pytest.raises(InputError, match=words):
        read_map(tmp_path / "m.bin")


def test_a_map_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_map(tmp_path / "m.bin")
