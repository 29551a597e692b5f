"""A flat specimen through the mapping of a series: refused, or with the known tilts."""

import numpy as np
import pytest

from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.mapping.context import SeriesContext
from semsfm_colmap.mapping.flat import find_flat, settle_flat
from semsfm_colmap.mapping.parts import map_observations
from semsfm_colmap.motion.prior import TiltPrior
from semsfm_colmap.refinement.model_choice import total_rotation
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from tests.refinement.test_flatness import relief, tilted

TILTS = np.linspace(0, 48, 7)


def context_of(tilts_deg=None):
    names = tuple(f"{i}.png" for i in range(7))
    tilt = None
    if tilts_deg is not None:
        tilt = TiltPrior(
            image_names=names,
            angle_rad=np.deg2rad(tilts_deg),
            sigma_rad=np.full(7, np.deg2rad(0.1)),
            axis_image_rad=None,
            source="a table",
        )
    return SeriesContext(
        image_names=names,
        image_size_px=np.full((7, 2), 1000),
        factorization=FactorizationOptions(),
        refinement=RefinementOptions(),
        tilt=tilt,
    )


@pytest.fixture(scope="module")
def plane():
    """The model that noise makes of a plane, whose angles are those it began with."""
    cameras, obs = tilted(relief(0.0), TILTS, start_scale=0.6)
    rng = np.random.default_rng(0)
    return refine(cameras, np.arange(7), obs, RefinementOptions(), rng=rng).value


def range_deg(refined):
    return np.rad2deg(total_rotation(np.asarray(refined.cameras.cam_from_world)))


def test_a_plane_without_known_tilts_gives_no_model(plane):
    found = find_flat(plane, plane)
    end = settle_flat(context_of(), plane, found)
    assert (end.value, end.status) == (None, "planar")
    assert "known up to one parameter" in end.message
    assert "48." in end.message


def test_known_tilts_settle_it(plane):
    end = settle_flat(context_of(TILTS), plane, find_flat(plane, plane))
    assert range_deg(end.value) == pytest.approx(48.0, abs=0.2)
    assert end.value.rms_px < 1.1 * plane.rms_px


def test_known_tilts_that_the_foreshortening_contradicts_do_not(plane):
    end = settle_flat(context_of(2.5 * TILTS), plane, find_flat(plane, plane))
    assert end.value is None
    assert "no plane turned by the known tilts" in end.message


def test_a_specimen_with_relief_is_not_flat():
    cameras, obs = tilted(relief(5.0), TILTS)
    rng = np.random.default_rng(0)
    fit = refine(cameras, np.arange(7), obs, RefinementOptions(), rng=rng).value
    assert find_flat(fit, fit) is None


@pytest.mark.parametrize("tilts_deg", [TILTS, np.linspace(-30, 30, 7)])
def test_a_series_of_a_plane_ends_in_that_answer(tilts_deg):
    _, obs = tilted(relief(0.0), tilts_deg)
    context = context_of()
    end = map_observations(
        obs,
        context.image_names,
        context.image_size_px,
        factorization=context.factorization,
        refinement=context.refinement,
    )
    assert (end.value, end.status) == (None, "planar")
    assert "flat" in end.message
