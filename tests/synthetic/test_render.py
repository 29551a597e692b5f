"""What is rendered lies where the cameras say and is as bright as the law says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.primitives import Mesh, geodesic_sphere, grid_faces, merged
from semsfm_colmap.synthetic.render import DETECTOR, MAX_YIELD, make_renderer
from semsfm_colmap.synthetic.scenes.base import Specimen
from semsfm_colmap.types import Array, Float, OrthographicCameras

PLAIN = SynthesizeOptions(
    albedo_contrast=0.0,
    detector_strength=0.0,
    edge_strength=0.0,
    thin_strength=0.0,
    cavity_strength=0.0,
    supersampling=4,
)
WIDTH, HEIGHT = 120, 100


def specimen_of(mesh: Mesh, texture: Float | None = None) -> Specimen:
    zeros = np.zeros(len(mesh[0]))
    return Specimen(
        vertices=mesh[0],
        faces=mesh[1],
        texture=zeros if texture is None else texture,
        label=zeros.astype(np.int64),
    )


def ball(centre: tuple[float, float, float], radius: float) -> Mesh:
    vertices, faces = geodesic_sphere(20)
    return vertices * radius + np.array(centre), faces


def camera(
    R: Float | None = None, scale: float = 40.0, aspect: float = 1.0, skew: float = 0.0
) -> OrthographicCameras:
    return OrthographicCameras(
        cam_from_world=(np.eye(3) if R is None else R)[None],
        scale_px_per_unit=np.array([scale]),
        translation_px=np.array([[60.0, 50.0]]),
        aspect=aspect,
        skew=skew,
    )


def render(
    specimen: Specimen,
    cameras: OrthographicCameras,
    options: SynthesizeOptions = PLAIN,
    shift: Float | None = None,
) -> tuple[Array, Array]:
    rng = np.random.default_rng(0)
    renderer = make_renderer(specimen, options, float(cameras.scale_px_per_unit[0]), rng)
    still = np.zeros((HEIGHT, 2)) if shift is None else shift
    return renderer.frame(cameras, 0, still, WIDTH)


def centroid(coverage: Array) -> Float:
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    weight = coverage.astype(np.float64) / coverage.sum()
    return np.array([np.sum(u * weight), np.sum(v * weight)])


def sheet(normal: Float, half: float = 1.5) -> Mesh:
    """A square, facing along `normal`."""
    side = np.cross(normal, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    up = np.cross(normal, side)
    corners = [-side - up, side - up, side + up, -side + up]
    return half * np.array(corners), np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_small_ball_appears_where_project_puts_its_centre(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cameras = camera(rotation_from_vector(rng.normal(size=3)), aspect=1.05, skew=0.03)
    centre = rng.uniform(-0.6, 0.6, 3)
    _, coverage = render(specimen_of(ball(tuple(centre), 0.15)), cameras)
    expected = cameras.project(centre[None], np.array([0]))[0]
    np.testing.assert_allclose(centroid(coverage), expected, atol=0.02)


def test_the_silhouette_of_a_ball_has_the_area_of_its_circle() -> None:
    _, coverage = render(specimen_of(ball((0.0, 0.0, 0.0), 0.9)), camera())
    assert coverage.sum() == pytest.approx(np.pi * (0.9 * 40.0) ** 2, rel=3e-3)


def test_the_outermost_vertices_mark_the_outline() -> None:
    vertices, faces = geodesic_sphere(3)
    vertices = vertices * np.random.default_rng(3).uniform(0.5, 1.1, (len(vertices), 1))
    cameras = camera(rotation_from_vector(np.array([0.3, 0.5, -0.2])))
    _, coverage = render(specimen_of((vertices, faces)), cameras)
    xy = cameras.project(vertices, np.zeros(len(vertices), np.int64))
    columns, rows = (np.flatnonzero(coverage.max(axis=k) > 0) for k in (0, 1))
    # The outline is polygonal: its corners are vertices, met to within a supersampled pixel.
    assert xy[:, 0].min() == pytest.approx(columns[0] + 0.5, abs=0.8)
    assert xy[:, 0].max() == pytest.approx(columns[-1] + 0.5, abs=0.8)
    assert xy[:, 1].min() == pytest.approx(rows[0] + 0.5, abs=0.8)
    assert xy[:, 1].max() == pytest.approx(rows[-1] + 0.5, abs=0.8)


def test_a_shifted_scan_line_shows_the_specimen_shifted() -> None:
    specimen = specimen_of(ball((0.1, -0.2, 0.0), 0.3))
    still = centroid(render(specimen, camera())[1])
    shift = np.tile([1.7, -0.6], (HEIGHT, 1))
    moved = centroid(render(specimen, camera(), shift=shift)[1])
    np.testing.assert_allclose(moved - still, [1.7, -0.6], atol=0.02)


def test_the_jitter_of_one_line_moves_that_line_alone() -> None:
    specimen = specimen_of(ball((0.0, 0.0, 0.0), 0.8))
    shift = np.zeros((HEIGHT, 2))
    shift[50, 0] = 3.0
    still, moved = (render(specimen, camera(), shift=s)[1] for s in (np.zeros_like(shift), shift))
    changed = np.flatnonzero(np.abs(moved - still).max(axis=1) > 0)
    assert changed.tolist() == [50]
    np.testing.assert_allclose(moved[50, 3:], still[50, :-3], atol=1e-6)


def test_what_is_nearer_to_the_viewer_hides_what_is_behind() -> None:
    near, far = ball((0.0, 0.0, -0.5), 0.3), ball((0.0, 0.0, 0.5), 0.3)
    texture = np.repeat([1.0, -1.0], [len(near[0]), len(far[0])])
    specimen = specimen_of(merged([near, far]), texture)
    options = replace(PLAIN, albedo_contrast=0.5)
    front, _ = render(specimen, camera(), options)
    back, _ = render(specimen, camera(np.diag([-1.0, 1.0, -1.0])), options)
    assert front[50, 60] == pytest.approx(1.5, rel=1e-2)
    assert back[50, 60] == pytest.approx(0.5, rel=1e-2)


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 60.0])
def test_brightness_grows_with_the_secant_of_the_tilt(angle_deg: float) -> None:
    a = np.radians(angle_deg)
    specimen = specimen_of(sheet(np.array([np.sin(a), 0.0, -np.cos(a)])))
    signal, coverage = render(specimen, camera())
    assert coverage[50, 60] == 1.0
    assert signal[50, 60] == pytest.approx(np.cos(a) ** -PLAIN.secant_exponent, rel=1e-4)


def test_grazing_surfaces_are_limited_in_brightness() -> None:
    a = np.radians(89.0)
    specimen = specimen_of(sheet(np.array([np.sin(a), 0.0, -np.cos(a)]), half=20.0))
    signal, coverage = render(specimen, camera())
    assert coverage[50, 60] == 1.0
    assert signal[50, 60] == pytest.approx(MAX_YIELD, rel=1e-3)


def test_the_side_of_the_detector_is_the_brighter_one() -> None:
    options = replace(PLAIN, detector_strength=0.5, secant_exponent=0.0)
    signal, _ = render(specimen_of(ball((0.0, 0.0, 0.0), 1.0)), camera(), options)
    u, v = (60 + 20 * np.array([1, -1]) * DETECTOR[0], 50 + 20 * np.array([1, -1]) * DETECTOR[1])
    bright, dark = signal[v.astype(int), u.astype(int)]
    assert bright > 1.1 * dark


def test_a_body_between_surface_and_detector_casts_a_shadow() -> None:
    floor = sheet(np.array([0.0, 0.0, -1.0]))
    above = ball(tuple(1.0 * DETECTOR), 0.2)
    specimen = specimen_of(merged([floor, above]))
    options = replace(PLAIN, shadowing=0.6)
    signal, _ = render(specimen, camera(), options)
    assert signal[50, 60] == pytest.approx(0.4, rel=1e-2)
    assert signal[90, 20] == pytest.approx(1.0, rel=1e-2)


def test_a_thin_plate_glows_more_than_a_thick_one() -> None:
    def plate(thickness: float) -> Mesh:
        front, back = sheet(np.array([0.0, 0.0, -1.0])), sheet(np.array([0.0, 0.0, 1.0]))
        return merged([front, (back[0] + [0.0, 0.0, thickness], back[1])])

    options = replace(PLAIN, thin_strength=1.0)
    thin, thick = (render(specimen_of(plate(t)), camera(), options)[0][50, 60] for t in (0.05, 2.0))
    # 0.05 units are 2 px, of a range of 8 px.
    assert thin == pytest.approx(1.0 + np.exp(-2.0 / 8.0), rel=1e-2)
    assert thick == pytest.approx(1.0, rel=1e-3)


def test_a_ridge_is_brighter_and_a_groove_darker_than_the_plane_beside() -> None:
    x, y = np.meshgrid(np.linspace(-1.5, 1.5, 151), np.linspace(-1.2, 1.2, 121), indexing="ij")
    z = 0.1 * np.exp(-(((x - 0.5) / 0.06) ** 2)) - 0.1 * np.exp(-(((x + 0.5) / 0.06) ** 2))
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    faces = grid_faces(151, 121)[:, ::-1]
    options = replace(PLAIN, edge_strength=0.5, secant_exponent=0.0)
    signal, _ = render(specimen_of((vertices, faces)), camera(), options)
    ridge, plane, groove = signal[50, 40], signal[50, 60], signal[50, 80]
    assert ridge > 1.1 * plane > 1.1 * 1.1 * groove


def test_a_specimen_out_of_view_leaves_the_frame_empty() -> None:
    signal, coverage = render(specimen_of(ball((50.0, 0.0, 0.0), 0.3)), camera())
    assert signal.max() == 0.0
    assert coverage.max() == 0.0
