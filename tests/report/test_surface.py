"""The error bars of the surface in the report: numbers, table and figure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.figure_style import gather
from semsfm_colmap.report.figures_surface import surface_sigma
from semsfm_colmap.report.html_tables import summary
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.metrics import compute_metrics
from semsfm_colmap.types import PointCloud, TriangleMesh
from tests.report.series import full_inputs, make_inputs, make_reconstruction

REC = make_reconstruction([0.0, 5.0, 10.0])


def ball(sigma: bool = True, normals: bool = True) -> PointCloud:
    direction = np.random.default_rng(0).normal(size=(3000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return PointCloud(
        points=8.0 * direction,
        normals=direction if normals else None,
        sigma=np.linspace(0.02, 0.06, 3000) if sigma else None,
    )


def drawn(inputs: ReportInputs) -> object:
    return surface_sigma(gather(inputs, compute_metrics(inputs)))


def test_the_summary_says_how_sure_the_surface_is_and_how_far_the_halves_are_apart() -> None:
    metrics = compute_metrics(full_inputs())
    assert metrics.cloud is not None
    assert metrics.cloud.median_sigma_world == pytest.approx(0.2)
    assert metrics.cloud.p95_sigma_world == pytest.approx(0.38)
    page = summary(metrics)
    assert "0.200 µm median, 95 % below 0.380 µm" in page
    assert "0.400 px apart, 0.330 of what their σ say (1.20 px)" in page


def test_a_cloud_without_error_bars_has_none() -> None:
    metrics = compute_metrics(make_inputs(REC, cloud=ball(sigma=False)))
    assert metrics.cloud is not None
    assert metrics.cloud.median_sigma_world is None
    assert "along its normals" not in summary(metrics)


def test_the_side_that_faces_the_middle_frame_is_drawn_in_the_colours_of_its_sigma() -> None:
    cloud = ball()
    figure = drawn(make_inputs(REC, cloud=cloud))
    assert not isinstance(figure, str)
    picture = figure.axes[0].collections[0]  # type: ignore[attr-defined]
    assert cloud.normals is not None
    facing = -cloud.normals @ REC.cameras.cam_from_world[1][2] > 0.1
    assert len(picture.get_offsets()) == facing.sum()
    assert cloud.sigma is not None
    shown = np.sort(np.asarray(picture.get_array()))
    np.testing.assert_allclose(shown, np.sort(cloud.sigma[facing]))


def test_the_mesh_goes_before_the_cloud() -> None:
    mesh = TriangleMesh(
        vertices=ball().points[:600],
        faces=np.arange(600).reshape(-1, 3),
        vertex_normals=ball().normals[:600],
        vertex_sigma=np.full(600, 0.5),
    )
    figure = drawn(make_inputs(REC, cloud=ball(), mesh=mesh))
    assert (np.asarray(figure.axes[0].collections[0].get_array()) == 0.5).all()  # type: ignore[attr-defined]


@pytest.mark.parametrize("cloud", [None, ball(sigma=False), ball(normals=False)])
def test_without_error_bars_or_normals_the_figure_says_so(cloud: PointCloud | None) -> None:
    assert drawn(make_inputs(REC, cloud=cloud)) == "there is no surface with error bars"


def test_a_surface_that_nobody_faces_is_said() -> None:
    cloud = ball()
    away = np.tile(REC.cameras.cam_from_world[1][2], (3000, 1))
    said = drawn(make_inputs(REC, cloud=replace(cloud, normals=away)))
    assert said == "no part of the surface faces the middle frame"
