import base64
import io
import json

import numpy as np
import pytest
from PIL import Image

from semsfm_colmap.errors import InputError
from semsfm_colmap.report.images.budgets import Budgets
from semsfm_colmap.report.images.colormaps import (
    ColorRange,
    color_range,
    color_table,
    colored,
    shrunk_map,
)
from semsfm_colmap.report.images.evidence import SeriesEvidence
from semsfm_colmap.report.images.mesh_view import MeshView
from semsfm_colmap.report.images.panels import build_panels
from semsfm_colmap.report.images.pictures import width_within
from semsfm_colmap.types import OrthographicCameras, TriangleMesh
from tests.report.images.evidence import make_evidence, numbered
from tests.report.series import SIZE_PX, cube, make_inputs, make_reconstruction, sphere


@pytest.fixture(scope="module")
def rec():
    return numbered(make_reconstruction(np.arange(4) * 6.0, window=2))


def picture(uri):
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.split(",")[1]))))


def test_the_panels_hold_what_is_known_of_each_frame(rec):
    inputs = make_inputs(
        rec, names=[*rec.image_names, "lost.png"], evidence=make_evidence(rec), mesh=sphere()
    )
    panels = build_panels(inputs, rec.residuals())
    assert panels is not None
    frames = panels.data["frames"]
    assert [f["name"] for f in frames] == [*rec.image_names, "lost.png"]
    assert all(f["picture"].startswith("data:image/webp;base64,") for f in frames)
    assert ["mesh" in f and f["mesh"] is not None for f in frames] == [True] * 4 + [False]
    assert ["depth" in f for f in frames] == [True] * 3 + [False] + [True]
    assert ["camera" in f for f in frames] == [True] * 4 + [False]
    assert len(frames[0]["camera"]) == 11
    first = frames[0]["depth"]
    assert first["low"] < first["high"]
    kept = int(np.sum(rec.observations.image_idx == 0))
    assert frames[0]["keypoints"]["counts"] == [0, 0, 0, 0, kept, 0]
    assert len(panels.data["pairs"]) == 3
    json.dumps(panels.data, allow_nan=False)


def test_the_camera_of_a_frame_projects_as_the_model_does(rec):
    panels = build_panels(make_inputs(rec, evidence=make_evidence(rec)), rec.residuals())
    assert panels is not None
    numbers = np.array(panels.data["frames"][2]["camera"])
    P, t, toward = numbers[:6].reshape(2, 3), numbers[6:8], numbers[8:]
    expected = rec.cameras.project(rec.points[:9], np.full(9, 2))
    np.testing.assert_allclose(rec.points[:9] @ P.T + t, expected, atol=1e-6)
    np.testing.assert_allclose(P @ toward, 0.0, atol=1e-9)


def test_a_long_series_keeps_within_its_budget_and_says_what_it_left_out():
    rec = numbered(make_reconstruction(np.arange(40) * 2.0, num_points=3000, window=4))
    evidence = make_evidence(rec, reach=3)
    noise = np.random.default_rng(0).integers(0, 256, (480, 640)).astype(np.uint8)
    inputs = make_inputs(
        rec,
        evidence=SeriesEvidence(
            read_pixels=lambda name: noise, images=evidence.images, pairs=evidence.pairs
        ),
    )
    limits = Budgets(
        picture_bytes=400_000, thumbnail_bytes=60_000, num_keypoints=9_000, num_residuals=4_000,
        num_trajectory_places=5_000, num_matches=6_000,
    )  # fmt: skip
    panels = build_panels(inputs, rec.residuals(), limits)
    assert panels is not None
    pictures = sum(len(f["picture"]) for f in panels.data["frames"])
    assert 150_000 < 0.75 * pictures < 1.1 * 400_000
    assert sum(f["keypoints"]["num"] for f in panels.data["frames"]) <= 9_000
    assert sum(p["num"] for p in panels.data["pairs"]) <= 6_000
    said = " ".join(panels.remarks)
    for thing in ("px wide", "keypoints are drawn", "residual vectors", "matches", "tracks"):
        assert thing in said


def test_images_that_are_gone_are_left_out_and_without_any_there_are_no_panels(rec):
    evidence = make_evidence(rec)

    def pixels(name):
        if name == rec.image_names[1] or missing:
            raise InputError("gone")
        return np.zeros((480, 640), dtype=np.uint8)

    gone = SeriesEvidence(read_pixels=pixels, images=evidence.images)
    missing = False
    panels = build_panels(make_inputs(rec, evidence=gone), rec.residuals())
    assert panels is not None
    assert [t is None for t in panels.thumbnails] == [False, True, False, False]
    missing = True
    assert build_panels(make_inputs(rec, evidence=gone), rec.residuals()) is None
    assert build_panels(make_inputs(rec), rec.residuals()) is None


def test_the_width_is_the_largest_that_fits():
    sizes = {400: 100, 200: 30, 100: 8}
    encode = [lambda width: bytes(sizes[width]), lambda width: bytes(2 * sizes[width])]
    assert width_within(1500, 10, encode, (400, 200, 100)) == 400
    assert width_within(1499, 10, encode, (400, 200, 100)) == 200
    assert width_within(1, 10, encode, (400, 200, 100)) == 100


def test_a_map_in_colours_is_transparent_where_nothing_is_known():
    values = np.array([[0.0, 1.0, np.nan, 2.0]])
    span = color_range(values)
    assert span is not None
    table = color_table("viridis")
    rgba = colored(values, span, table)
    np.testing.assert_array_equal(rgba[0, :, 3], [255, 255, 0, 255])
    np.testing.assert_array_equal(rgba[0, [0, 3], :3], table[[0, 255]])
    assert color_range(np.full((2, 2), np.nan)) is None
    assert set(shrunk_map(np.arange(100.0).reshape(10, 10), 3).ravel()) <= set(range(100))


def test_a_value_as_large_as_its_type_holds_has_the_last_colour():
    values = np.array([[0.1, np.finfo(np.float32).max]], dtype=np.float32)
    rgba = colored(values, ColorRange(low=0.1, high=0.4), color_table("viridis"))
    assert rgba[0, 1, :3].tolist() == color_table("viridis")[-1].tolist()


def camera(R, scale=20.0):
    return OrthographicCameras(
        cam_from_world=np.array([R]),
        scale_px_per_unit=np.array([scale]),
        translation_px=np.array([[320.0, 240.0]]),
    )


def test_the_mesh_lies_in_the_picture_where_the_camera_projects_it():
    view = MeshView(cube(4.0))
    hits = view.hits(camera(np.eye(3)), 0, SIZE_PX, 320)
    face, place = hits.face, hits.place
    seen = face >= 0
    # the cube spans 0..4 um, 320..400 px in x and 240..320 px in y, in a picture of half the size
    rows, columns = np.nonzero(seen)
    assert (columns.min(), columns.max()) == (160, 199)
    assert (rows.min(), rows.max()) == (120, 159)
    assert seen.sum() == 1600
    assert place[seen].min() >= -1e-4
    # the viewer is at -z: the near side is z = 0
    mesh = cube(4.0)
    np.testing.assert_allclose(mesh.vertices[mesh.faces[face[seen]]][..., 2], 0.0)


def test_the_picture_of_a_mesh_is_in_its_own_colours_or_shaded():
    mesh = cube(4.0)
    front = camera(np.eye(3))
    bare = MeshView(mesh)
    assert bare.textured(bare.hits(front, 0, SIZE_PX, 160)) is None
    red = TriangleMesh(
        vertices=mesh.vertices,
        faces=mesh.faces,
        vertex_colors=np.tile(np.array([200, 30, 10], dtype=np.uint8), (8, 1)),
    )
    view = MeshView(red)
    picture = view.textured(view.hits(front, 0, SIZE_PX, 160))
    assert picture is not None
    seen = picture[..., 3] == 255
    np.testing.assert_array_equal(np.unique(picture[seen, :3], axis=0), [[200, 30, 10]])
    view = MeshView(sphere(40))
    ball = view.shaded(view.hits(front, 0, SIZE_PX, 320))
    inside = ball[..., 3] == 255
    rows, columns = np.nonzero(inside)
    height = ball[..., 0].astype(int)
    # steep rims are brighter than the middle, the upper left brighter than the lower right
    middle = height[int(rows.mean()), int(columns.mean())]
    assert height[inside].max() > middle + 60
    half = (rows - rows.mean()) + (columns - columns.mean()) < 0
    assert (
        height[rows[half], columns[half]].mean() > height[rows[~half], columns[~half]].mean() + 10
    )
