from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.sizes.places import (
    at_pixel,
    at_vertex,
    gradients,
    in_polygon,
    inside,
    with_label,
)
from semsfm_colmap.metrology.sizes.requests import PlaceRequest, disc_corners
from semsfm_colmap.metrology.sizes.specimen import Specimen
from semsfm_colmap.types import SemFrame
from tests.metrology.sizes.builders import RADIUS_PX, ball, sheet, simulated_model


def in_disc(specimen, image, centre, radius_px, what):
    corners = disc_corners(PlaceRequest(image=image, xy=centre), radius_px)
    found = in_polygon(specimen, image, np.array([corner.xy for corner in corners]), what)
    return found.vertices


@pytest.fixture(scope="module")
def specimen():
    return Specimen(model=simulated_model(), mesh=ball())


def test_a_pixel_shows_the_near_side_of_the_ball(specimen):
    cameras = specimen.model.cameras
    t, v = cameras.translation_px[4], cameras.viewing_direction[4]
    found = at_pixel(specimen, "im_4.tif", (t[0], t[1]), "top")
    np.testing.assert_allclose(found.points[0], -RADIUS_PX * v, atol=1.0)
    assert found.normals[0] @ v < -0.99
    assert found.image[0] == 4
    assert found.weights[0].sum() == specimen.model.num_images


def test_a_place_lies_on_the_ray_of_its_pixel(specimen):
    found = at_pixel(specimen, "im_2.tif", (420.0, 610.0), "p")
    seen = specimen.model.cameras.project(found.points, np.array([2]))
    np.testing.assert_allclose(seen, [[420.0, 610.0]], atol=1e-3)


def test_drift_and_drag_of_the_image_are_taken_out_of_the_pixel(specimen):
    drift = np.zeros((specimen.model.num_images, 2))
    drift[2] = 3.0, -2.0
    model = replace(specimen.model, drift_px=drift, drag_px=0.8)
    moved = at_pixel(replace(specimen, model=model), "im_2.tif", (420.0, 800.0), "p")
    n = moved.normals[0] @ model.cameras.cam_from_world[2].T
    q = model.cameras.project(moved.points, np.array([2]))[0]
    row = (q[1] - 500.0) / 1000.0
    back = q + np.array([3.0, -2.0]) * row - 0.8 * n[2] * n[:2]
    np.testing.assert_allclose(back, [420.0, 800.0], atol=0.02)
    shown = replace(specimen, model=model).shown(2, moved.points, moved.normals)
    np.testing.assert_allclose(shown, [[420.0, 800.0]], atol=0.02)


def frame(name, crop):
    return SemFrame(
        name=name,
        width_px=1000,
        height_px=1000,
        source_path=f"/data/{name[:-4]}_raw.tif",
        crop_px=crop,
    )


def test_pixels_are_those_of_the_original_image(specimen):
    frames = tuple(frame(name, (30, 12, 1030, 1012)) for name in specimen.model.image_names)
    cropped = replace(specimen, frames=frames)
    a = at_pixel(specimen, "im_1.tif", (420.0, 610.0), "p")
    b = at_pixel(cropped, "im_1_raw.tif", (450.0, 622.0), "p")
    np.testing.assert_allclose(a.points, b.points)
    np.testing.assert_allclose(cropped.shown(1, b.points, b.normals), [[450.0, 622.0]], atol=1e-3)
    with pytest.raises(InputError, match="lies outside of the image, of which x 30 to 1030"):
        at_pixel(cropped, "im_1.tif", (20.0, 500.0), "p")


def test_a_place_outside_of_the_image_is_said(specimen):
    with pytest.raises(InputError, match=r"im_0.tif:1200,5 lies outside .* pick a place within"):
        at_pixel(specimen, "im_0.tif", (1200.0, 5.0), "p")


def test_a_place_outside_of_the_mask_is_said(specimen):
    mask = np.full((1000, 1000), 255, dtype=np.uint8)
    mask[:520] = 0
    masked = replace(specimen, mask=lambda name: mask if name == "im_0.tif" else None)
    with pytest.raises(InputError, match=r"im_0.tif:500,505 is masked out: pick a place"):
        at_pixel(masked, "im_0.tif", (500.0, 505.0), "p")
    assert len(at_pixel(masked, "im_1.tif", (500.0, 505.0), "p")) == 1


def test_no_surface_there_is_said(specimen):
    with pytest.raises(InputError, match=r"tip: the surface at im_0.tif:20,20 is not there"):
        at_pixel(specimen, "im_0.tif", (20.0, 20.0), "tip")


def test_a_filling_is_no_place(specimen):
    filled = replace(specimen.mesh, face_filled=np.ones(len(specimen.mesh.faces), dtype=bool))
    with pytest.raises(InputError, match="closes a hole that no image shows"):
        at_pixel(replace(specimen, mesh=filled), "im_0.tif", (500.0, 500.0), "tip")


def test_an_unknown_image_is_said(specimen):
    with pytest.raises(InputError, match=r"no image is called x.tif: the images are im_0.tif"):
        at_pixel(specimen, "x.tif", (1.0, 1.0), "p")


def test_without_a_mesh_it_is_the_nearest_track(specimen):
    d = specimen.model.points / np.linalg.norm(specimen.model.points, axis=1, keepdims=True)
    model = replace(specimen.model, points=RADIUS_PX * d)
    obs = model.observations
    seen = model.cameras.project(model.points[obs.track_idx], obs.image_idx)
    bare = Specimen(model=replace(model, observations=replace(obs, xy=seen)), mesh=None)
    v = model.cameras.viewing_direction[obs.image_idx]
    row = int(np.flatnonzero(np.einsum("oi,oi->o", d[obs.track_idx], v) < -0.9)[0])
    name = model.image_names[obs.image_idx[row]]
    found = at_pixel(bare, name, tuple(seen[row] + [2.0, 0.0]), "p")
    assert found.track[0]
    shown = model.cameras.project(found.points, obs.image_idx[row : row + 1])
    np.testing.assert_allclose(shown[0], seen[row] + [2.0, 0.0], atol=1e-6)
    assert np.linalg.norm(found.points[0] - model.points[obs.track_idx[row]]) < 4.0
    images = np.flatnonzero(found.weights[0])
    np.testing.assert_array_equal(images, obs.image_idx[obs.track_idx == obs.track_idx[row]])
    with pytest.raises(InputError, match=r"no reconstructed point lies within 5 px .*semsfm mesh"):
        at_pixel(bare, name, (1.0, 1.0), "p")
    with pytest.raises(InputError, match="there is no mesh"):
        in_disc(bare, name, (500.0, 500.0), 20.0, "r")


def test_a_vertex_that_does_not_exist_is_said(specimen):
    assert len(at_vertex(specimen, 5, "v")) == 1
    with pytest.raises(
        InputError, match=r"v: vertex 999999 does not exist: the mesh has vertices 0"
    ):
        at_vertex(specimen, 999999, "v")


def test_a_disc_takes_the_near_side_alone(specimen):
    chosen = in_disc(specimen, "im_4.tif", (500.0, 500.0), 150.0, "r")
    v = specimen.model.cameras.viewing_direction[4]
    assert len(chosen) > 50
    assert np.all(specimen.mesh.vertices[chosen] @ v < 0.0)
    away = specimen.model.cameras.project(specimen.mesh.vertices[chosen], np.full(len(chosen), 4))
    assert np.linalg.norm(away - 500.0, axis=1).max() <= 150.5


def test_a_region_with_a_hole_is_refused_where_it_matters(specimen):
    height = np.zeros((60, 60))
    height[25:35, 25:35] = np.nan
    plate = replace(specimen, mesh=sheet(height))
    corners = [(440.0, 440.0), (560.0, 440.0), (560.0, 560.0), (440.0, 560.0)]
    found = in_polygon(plate, "im_4.tif", np.array(corners), "spot")
    assert len(found.vertices) > 100
    assert found.missing == pytest.approx(44.0**2 / 120**2, rel=0.05)
    with pytest.raises(InputError, match=r"spot: \d+% of the region has no surface"):
        in_polygon(plate, "im_4.tif", np.array(corners), "spot", whole=True)


def test_a_region_without_surface_is_said(specimen):
    with pytest.raises(InputError, match="spot: no surface is there"):
        in_disc(specimen, "im_4.tif", (60.0, 60.0), 20.0, "spot")


def test_labels_that_are_not_there_are_said(specimen):
    with pytest.raises(InputError, match="r: the mesh has no labels: run `semsfm segment` first"):
        with_label(specimen, "specimen", "r")
    labels = np.arange(len(specimen.mesh.vertices)) % 2
    parted = replace(specimen, labels=labels, label_names={"specimen": 1})
    assert np.all(with_label(parted, "specimen", "r").vertices % 2 == 1)
    with pytest.raises(InputError, match="no part is named coil: the parts are specimen"):
        with_label(parted, "coil", "r")


def test_inside_is_the_even_odd_rule():
    star = np.array([[0, 0], [4, 0], [4, 4], [2, 2], [0, 4]], dtype=float)
    points = np.array([[2, 1], [2, 3], [1, 2.5], [5, 1], [-1, 2]], dtype=float)
    np.testing.assert_array_equal(inside(points, star), [True, False, True, False, False])


def test_a_pick_follows_the_surface_along_its_ray(specimen):
    """The gradient by the surface against one whose surface has moved."""
    pixel = (430.0, 580.0)
    e = 0.5
    here = at_pixel(specimen, "im_3.tif", pixel, "p")
    there = at_pixel(replace(specimen, mesh=ball(RADIUS_PX + e, 24)), "im_3.tif", pixel, "p")
    g = np.array([[0.3, -0.5, 0.8]])
    by_surface, by_ray = gradients(here, g, specimen.model.cameras.viewing_direction)
    change = float((g * (there.points - here.points)).sum())
    assert float(by_surface[0] @ here.normals[0]) * e == pytest.approx(change, rel=0.02)
    assert by_ray[0] @ specimen.model.cameras.viewing_direction[3] == pytest.approx(0.0, abs=1e-12)


def test_a_mesh_of_another_model_is_refused(specimen):
    rough = specimen.model.points / np.linalg.norm(specimen.model.points, axis=1, keepdims=True)
    model = replace(specimen.model, points=RADIUS_PX * rough)
    obs = model.observations
    seen = model.cameras.project(model.points[obs.track_idx], obs.image_idx)
    own = replace(specimen, model=replace(model, observations=replace(obs, xy=seen)))
    own.check_one_world()
    for mesh in (ball(0.05 * RADIUS_PX), ball(RADIUS_PX + 30.0)):
        with pytest.raises(InputError, match=r"it is of another model; run `semsfm densify`"):
            replace(own, mesh=mesh).check_one_world()
