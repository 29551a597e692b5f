from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.mapping.joint_covariance import joint_covariance
from semsfm_colmap.metrology.sizes.budget import COVERAGE_FACTOR
from semsfm_colmap.metrology.sizes.covariance import PICKING_PX, Errors, ScaleError
from semsfm_colmap.metrology.sizes.request_file import parse_known_length, parse_requests
from semsfm_colmap.metrology.sizes.run import measure
from semsfm_colmap.metrology.sizes.specimen import Specimen
from semsfm_colmap.metrology.sizes.surface_error import surface_error
from semsfm_colmap.refinement.options import RefinementOptions
from tests.mapping.test_joint_covariance import turned
from tests.metrology.sizes.builders import RADIUS_PX, ball, sheet, simulated_model

DISTANCE = '[measurements]\nd = { distance = ["im_4.tif:420,500", "im_4.tif:590,520"] }\n'


@pytest.fixture(scope="module")
def model():
    return simulated_model()


@pytest.fixture(scope="module")
def specimen(model):
    return Specimen(model=model, mesh=ball())


def errors_of(specimen, scale=None):
    return Errors(
        cameras=joint_covariance(specimen.model, RefinementOptions(), None),
        surface=surface_error(specimen.mesh.vertex_sigma, specimen.px),
        model_cameras=specimen.model.cameras,
        relief_px=1.1,
        scale=scale,
        unit="px" if scale is None else "um",
    )


@pytest.fixture(scope="module")
def errors(specimen):
    return errors_of(specimen)


def one(specimen, errors, text):
    found, checks = measure(specimen, errors, parse_requests(text, "m.toml"))
    return (*found, *checks)[0]


def parts(found):
    return {source.name: source.contribution for source in found.sources}


def test_a_budget_adds_up(specimen, errors):
    found = one(specimen, errors, DISTANCE)
    assert found.sigma == pytest.approx(np.linalg.norm(list(parts(found).values())))
    assert sum(found.share(source) for source in found.sources) == pytest.approx(1.0)
    low, high = found.interval
    assert high - low == pytest.approx(2 * COVERAGE_FACTOR * found.sigma)
    for source in found.sources:
        if source.size:
            assert source.sensitivity * source.size == pytest.approx(source.contribution)
    assert {source.kind for source in found.sources} == {"A", "B"}


def test_lengths_in_px_have_no_scale_and_say_so(specimen, errors):
    found = one(specimen, errors, DISTANCE)
    assert found.unit == "px"
    assert "pixel size" not in parts(found)
    assert "pixel size: none is known, lengths are in px" in found.not_assessed


def test_the_pixel_size_goes_with_the_power_of_the_unit(specimen):
    scaled = errors_of(specimen, ScaleError(sigma=0.03))
    volume = one(specimen, scaled, "[measurements]\nv = { volume = { everything = true } }\n")
    assert volume.unit == "um^3"
    assert parts(volume)["pixel size"] == pytest.approx(0.09 * volume.value)
    text = '[measurements]\nw = { angle = ["im_4.tif:420,500", "vertex:3", "im_4.tif:590,520"] }\n'
    assert "pixel size" not in parts(one(specimen, scaled, text))


def test_a_ball_has_its_radius_and_its_offset_is_uncertain_in_full(specimen, errors):
    text = '[measurements]\nr = { sphere = { disc = "im_4.tif:500,500", radius_px = 150 } }\n'
    found = one(specimen, errors, text)
    assert found.value == pytest.approx(RADIUS_PX, abs=1e-6)
    assert parts(found)["surface: common offset"] == pytest.approx(errors.surface.common, rel=1e-6)
    twice = one(
        specimen,
        errors,
        text.replace("radius_px = 150 } }", "radius_px = 150 }, diameter = true }"),
    )
    assert twice.value == pytest.approx(2 * RADIUS_PX, abs=1e-6)
    assert twice.sigma == pytest.approx(2 * found.sigma)


def test_two_near_places_of_one_frame_are_less_uncertain_than_two_apart_by_themselves(
    specimen, errors
):
    """Their cameras and their surface err alike; only the reading of the pixels does not."""
    text = '[measurements]\nd = {{ distance = ["im_4.tif:500,500", "im_4.tif:{},500"] }}\n'
    near, far = (parts(one(specimen, errors, text.format(x))) for x in (504, 700))
    for name in ("cameras: noise", "cameras: drag", "surface: offset by where it faces"):
        assert near[name] < 0.1 * far[name], name
    # frontal places: all of the reading goes into the distance
    assert near["picking"] == pytest.approx(np.sqrt(2) * PICKING_PX, rel=0.05)


def test_a_distance_does_not_depend_on_the_world(specimen, errors):
    Q = rotation_from_vector(np.array([0.9, -0.2, 0.5]))
    shift, scale = np.array([7.0, -3.0, 2.0]), 0.05
    mesh = replace(
        specimen.mesh,
        vertices=scale * specimen.mesh.vertices @ Q.T + shift,
        vertex_normals=specimen.mesh.vertex_normals @ Q.T,
        vertex_sigma=scale * specimen.mesh.vertex_sigma,
    )
    other = Specimen(model=turned(specimen.model, Q, shift, scale), mesh=mesh)
    for text in (
        DISTANCE,
        '[measurements]\nr = { sphere = { disc = "im_4.tif:500,500", radius_px = 150 } }\n',
    ):
        here, there = one(specimen, errors, text), one(other, errors_of(other), text)
        assert there.value == pytest.approx(scale * here.value, rel=1e-5)
        assert there.sigma == pytest.approx(scale * here.sigma, rel=2e-3)
        for name, part in parts(here).items():
            if part > 0.01 * here.sigma:
                assert parts(there)[name] == pytest.approx(scale * part, rel=0.02), name


def test_a_known_length_is_compared_and_never_used(specimen, errors):
    scaled = replace(errors, scale=ScaleError(sigma=0.001), unit="um")
    text = DISTANCE.replace("measurements", "checks").replace(
        " }\n", ", length = KNOWN, sigma = 0.5 }\n"
    )
    plain = one(specimen, scaled, DISTANCE)
    for known in (plain.value + 0.1, plain.value + 100.0):
        found = one(specimen, scaled, text.replace("KNOWN", str(known)))
        assert found.value == plain.value
        check = found.check
        both = COVERAGE_FACTOR * np.hypot(plain.sigma, 0.5)
        assert check.en == pytest.approx((plain.value - known) / both)
        assert check.agrees == (known < plain.value + 50.0)


def test_a_check_in_px_is_refused(specimen, errors):
    text = DISTANCE.replace("measurements", "checks").replace(" }\n", ", length = 3.0 }\n")
    with pytest.raises(InputError, match="check d: the project has no scale"):
        one(specimen, errors, text)


def test_a_known_length_sets_the_scale(specimen, errors):
    known = parse_known_length("im_4.tif:420,500,im_4.tif:590,520,34.0,0.1")
    asked = replace(parse_requests(DISTANCE, "m.toml"), scale_from=known)
    (same,), _ = measure(specimen, errors, asked)
    assert (same.value, same.unit) == (pytest.approx(34.0), "um")
    # of the very length that sets the scale nothing but its own uncertainty is left
    assert same.sigma == pytest.approx(0.1, rel=1e-6)
    text = '[measurements]\nr = { sphere = { disc = "im_4.tif:500,500", radius_px = 150 } }\n'
    (ball_found,), _ = measure(
        specimen, errors, replace(parse_requests(text, "m.toml"), scale_from=known)
    )
    plain = one(specimen, errors, DISTANCE).value
    assert ball_found.value == pytest.approx(34.0 / plain * RADIUS_PX)
    assert any(source.name.startswith("known length") for source in ball_found.sources)


def plate(specimen, height):
    return replace(specimen, mesh=sheet(height))


def test_a_profile_has_the_heights_of_the_surface_with_their_sigma(specimen):
    x = np.linspace(-1, 1, 80)[:, None]
    flat = plate(specimen, 20.0 * np.exp(-((x / 0.3) ** 2)) + np.zeros((1, 80)))
    text = (
        '[measurements]\nl = { profile = ["im_4.tif:400,500", "im_4.tif:600,500"], samples = 21 }\n'
    )
    found = one(flat, errors_of(flat), text)
    rows = np.array(found.profile)
    assert found.value == pytest.approx(20.0, rel=0.05)
    assert rows.shape == (21, 3)
    assert rows[[0, -1], 1] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert 0.0 < rows[10, 2] < 3.0


def test_a_line_over_a_hole_is_refused(specimen):
    height = np.zeros((80, 80))
    height[38:42] = np.nan
    holed = plate(specimen, height)
    text = '[measurements]\nl = { profile = ["im_4.tif:400,500", "im_4.tif:600,500"] }\n'
    with pytest.raises(InputError, match=r"runs over a hole at im_4.tif:\d+,500, .* beside it"):
        one(holed, errors_of(holed), text)


def test_a_profile_between_two_images_is_refused(specimen, errors):
    text = '[measurements]\nl = { profile = ["im_4.tif:400,500", "im_3.tif:600,500"] }\n'
    with pytest.raises(InputError, match="runs between two places in one image"):
        one(specimen, errors, text)


def test_the_volume_of_an_open_part_is_refused(specimen):
    flat = plate(specimen, np.zeros((40, 40)))
    with pytest.raises(InputError, match=r"v is open .* encloses no volume"):
        one(flat, errors_of(flat), "[measurements]\nv = { volume = { everything = true } }\n")


def test_too_few_vertices_for_a_fit_are_said(specimen, errors):
    text = '[measurements]\nr = { sphere = { disc = "im_4.tif:500,500", radius_px = 8 } }\n'
    with pytest.raises(InputError, match=r"r holds \d points of the surface, but a sphere needs 4"):
        one(specimen, errors, text)


def test_without_error_bars_the_surface_is_not_assessed(specimen):
    bare = replace(specimen, mesh=replace(specimen.mesh, vertex_sigma=None))
    errors = replace(errors_of(specimen), surface=None)
    found = one(bare, errors, DISTANCE)
    assert "surface: the mesh has no sigma" in found.not_assessed
    assert not any(name.startswith("surface") for name in parts(found))


def test_a_step_is_as_uncertain_as_its_planes_and_not_by_what_they_share(specimen):
    height = np.zeros((80, 80))
    height[40:] = 30.0
    step = plate(specimen, height + 0.5 * np.random.default_rng(1).normal(size=height.shape))
    low, high = (
        "{ polygon = ["
        + ", ".join(f'"im_4.tif:{x},{y}"' for x, y in ((a, 400), (b, 400), (b, 600), (a, 600)))
        + "] }"
        for a, b in ((360, 470), (530, 640))
    )
    text = f"[regions]\nlow = {low}\nhigh = {high}\n"
    text += '[measurements]\nh = { step_height = ["low", "high"] }\n'
    found = one(step, errors_of(step), text)
    assert found.value == pytest.approx(30.0, abs=4 * found.sigma)
    assert parts(found)["surface: common offset"] < 0.02 * found.sigma
    assert parts(found)["surface: offset by where it faces"] < 0.02 * found.sigma


def test_a_small_hole_is_in_the_budget_of_an_area(specimen):
    height = np.zeros((80, 80))
    height[40:43, 40:43] = np.nan
    holed = plate(specimen, height)
    corners = ", ".join(
        f'"im_4.tif:{x},{y}"' for x, y in ((400, 400), (600, 400), (600, 600), (400, 600))
    )
    found = one(
        holed, errors_of(holed), f"[measurements]\na = {{ area = {{ polygon = [{corners}] }} }}\n"
    )
    share = parts(found)["surface: holes of the region"] / found.value
    assert share == pytest.approx(16.0**2 / 200**2, rel=0.3)
    assert found.value == pytest.approx(200.0**2, rel=0.02)


def test_a_surface_that_is_no_sphere_has_a_radius_with_a_remark(specimen, errors):
    text = '[measurements]\nr = { sphere = { disc = "im_4.tif:500,500", radius_px = 150 } }\n'
    assert one(specimen, errors, text).remarks == ()
    x, y = np.meshgrid(np.linspace(-1, 1, 80), np.linspace(-1, 1, 80), indexing="ij")
    waves = plate(specimen, 20.0 * np.sin(6 * x) * np.cos(5 * y) - 40.0 * (x**2 + y**2))
    (remark,) = one(waves, errors_of(waves), text).remarks
    assert "the surface departs from the best sphere by" in remark


def test_an_angle_that_may_be_zero_has_a_remark(specimen):
    flat = plate(specimen, np.zeros((80, 80)))
    spot = '{{ disc = "im_4.tif:{},500", radius_px = 40 }}'
    text = f"[measurements]\nw = {{ plane_angle = [{spot.format(450)}, {spot.format(550)}] }}\n"
    found = one(flat, errors_of(flat), text)
    assert found.value < 1e-6
    assert any("the interval is not symmetric" in remark for remark in found.remarks)
