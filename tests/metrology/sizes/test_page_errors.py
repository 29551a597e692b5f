from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.mapping.joint_covariance import joint_covariance
from semsfm_colmap.metrology.sizes.budget import standard_uncertainty
from semsfm_colmap.metrology.sizes.compact_covariance import (
    MAX_LOSS,
    monomials,
    toward,
    viewing_directions,
)
from semsfm_colmap.metrology.sizes.covariance import Errors, ScaleError
from semsfm_colmap.metrology.sizes.page_errors import page_errors
from semsfm_colmap.metrology.sizes.places import at_vertices
from semsfm_colmap.metrology.sizes.quantities import angle, distance
from semsfm_colmap.metrology.sizes.specimen import Specimen
from semsfm_colmap.metrology.sizes.surface_error import surface_error
from semsfm_colmap.refinement.options import RefinementOptions
from tests.metrology.sizes.builders import ball, simulated_model
from tests.oracles.page_budget import cameras_sigma, surface_sigmas


@pytest.fixture(scope="module")
def specimen():
    mesh = ball()
    rng = np.random.default_rng(4)
    sigma = 0.6 + 0.5 * rng.random(len(mesh.vertices))
    model = replace(simulated_model(), drag_px=0.5)
    return Specimen(model=model, mesh=replace(mesh, vertex_sigma=sigma))


@pytest.fixture(scope="module")
def errors(specimen):
    return Errors(
        cameras=joint_covariance(specimen.model, RefinementOptions(), None),
        surface=surface_error(specimen.mesh.vertex_sigma, specimen.px),
        model_cameras=specimen.model.cameras,
        relief_px=1.1,
        scale=ScaleError(sigma=0.001),
        unit="um",
    )


@pytest.fixture(scope="module")
def page(specimen, errors):
    return page_errors(specimen, errors)


def of_page(page, specimen, vertices, quantity):
    """The page's cameras, and its surface in parts."""
    places = at_vertices(specimen, vertices)
    cameras = cameras_sigma(
        page.header["cameras"], page.arrays, places.points, places.normals, places.weights,
        quantity.gradient,
    )  # fmt: skip
    surface = surface_sigmas(
        page.header["surface"], places.points, places.normals, places.sigma, quantity.gradient
    )
    return cameras, surface


def quantity_of(specimen, vertices):
    ends = [at_vertices(specimen, np.array([k])) for k in vertices]
    return distance(*ends, "d") if len(ends) == 2 else angle(*ends, "a")


def some_vertices(specimen, number, seed):
    """Random vertices on the sides that images see, and neighbours."""
    rng = np.random.default_rng(seed)
    facing = np.flatnonzero(specimen.normals[:, 2] < -0.2)
    chosen = [rng.choice(facing, number, replace=False) for _ in range(12)]
    near = []
    for k in rng.choice(facing, 6, replace=False):
        away = np.linalg.norm(specimen.mesh.vertices - specimen.mesh.vertices[k], axis=1)
        near.append(np.argsort(away)[:number])
    # of a place that no two images see, those it is turned away from count too
    away = np.flatnonzero(specimen.normals[:, 2] > 0.3)
    hidden = [[*rng.choice(facing, number - 1), rng.choice(away)] for _ in range(4)]
    return [*chosen, *near, *(np.array(some) for some in hidden)]


@pytest.mark.parametrize("number", [2, 3])
def test_sigmas_of_lengths_and_angles_are_those_of_measure(page, specimen, errors, number):
    for vertices in some_vertices(specimen, number, seed=number):
        quantity = quantity_of(specimen, vertices)
        sources = errors.sources(quantity)
        cameras, surface = of_page(page, specimen, vertices, quantity)
        expected = standard_uncertainty([s for s in sources if s.name.startswith("cameras")])
        # what the modes leave out is only ever missing
        assert (1.0 - MAX_LOSS) * expected < cameras < 1.0001 * expected
        for source in sources:
            if source.name.startswith("surface"):
                assert surface[source.name] == pytest.approx(source.contribution, rel=1e-3)
        scale = page.header["scale"]["sigma"] * quantity.value * quantity.dimension
        total = np.sqrt(cameras**2 + sum(u**2 for u in surface.values()) + scale**2)
        assert total == pytest.approx(standard_uncertainty(sources), rel=0.01)


def test_the_modes_leave_out_no_more_than_they_say(page):
    assert 0.0 <= page.header["cameras"]["largest_loss"] <= MAX_LOSS
    kept = page.arrays["displacement"].shape[3]
    assert kept < 9 * 7 + 1


def test_the_polynomials_are_what_moves_the_pixels(specimen, errors, page):
    """Against the derivatives of a place that was not among those that they were fitted to."""
    cameras = errors.cameras
    X = np.array([[20.0, -150.0, -250.0]])
    head = page.header["cameras"]
    for i, v in enumerate(viewing_directions(cameras.projection)):
        n = toward(v, np.array([[0.3, -0.2, -np.sqrt(1 - 0.13)]]))
        basis = monomials(
            X, n, np.array(head["exponents"]), np.array(head["center"]), head["radius"]
        )
        Q = np.asarray(page.arrays["displacement"][i], dtype=np.float64)
        shown = np.einsum("b,xbk->xk", basis[0], Q)
        J = cameras.image_derivatives(X, n, i)[0]
        # the modes of the page span what it kept: each is J times a direction of the parameters
        direction = np.linalg.lstsq(J, shown, rcond=None)[0]
        np.testing.assert_allclose(J @ direction, shown, atol=1e-5 * np.abs(shown).max())


def test_without_a_covariance_of_the_cameras_nothing_is_claimed(specimen, errors):
    bare = page_errors(specimen, replace(errors, cameras=None))
    assert bare is not None
    assert bare.header["cameras"] is None
    assert bare.arrays == {}
    assert any("cameras" in words for words in bare.header["not_assessed"])


def test_without_a_mesh_there_is_nothing_to_measure(specimen, errors):
    assert page_errors(replace(specimen, mesh=None), errors) is None


def test_images_that_see_a_place_are_told_from_those_it_follows():
    specimen = Specimen(model=simulated_model(), mesh=ball())
    behind = int(np.argmax(specimen.mesh.vertices[:, 2]))
    sees = specimen.sees(specimen.mesh.vertices[[behind]], specimen.normals[[behind]])
    assert not sees.any()
    assert specimen.followed(sees).all()
