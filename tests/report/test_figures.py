from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.figure_style import gather
from semsfm_colmap.report.figures import FIGURES, draw_figures
from semsfm_colmap.report.figures_images import (
    detected_regions,
    filtered_matches,
    trajectories,
)
from semsfm_colmap.report.figures_structure import meshed_surface, textured_structure
from semsfm_colmap.report.figures_visibility import visibility_raster
from semsfm_colmap.report.inputs import StageUsage
from semsfm_colmap.report.metrics import compute_metrics
from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.types import PointCloud
from tests.report.images.evidence import make_evidence, numbered
from tests.report.series import (
    chain_of_pairs,
    empty_reconstruction,
    make_inputs,
    make_reconstruction,
    sphere,
)

PNG = b"\x89PNG\r\n\x1a\n"


def inputs_of(num_images, **changes):
    rec = numbered(
        make_reconstruction(
            np.arange(num_images) * 360.0 / max(num_images, 40),
            num_points=10 * num_images,
            sigma_rotation_rad=np.full((num_images, 3), 1e-3),
            sigma_scale=np.full(num_images, 1e-4),
            **changes,
        )
    )
    return make_inputs(
        rec,
        pairs=chain_of_pairs(rec.image_names),
        evidence=make_evidence(rec),
        mesh=sphere(30),
        cloud=PointCloud(
            points=rec.points,
            normals=rec.points / np.linalg.norm(rec.points, axis=1, keepdims=True),
            sigma=np.linspace(0.01, 0.1, len(rec.points)),
        ),
        stages=tuple(
            StageUsage(name=name, seconds=seconds)
            for name, seconds in (
                ("extract", 30.0),
                ("a very long name of a stage", 0.01),
                ("match", 61.0),
            )
        ),
    )


def drawn(inputs):
    return draw_figures(inputs, compute_metrics(inputs), ReportOptions(figure_dpi=50))


@pytest.fixture(scope="module", params=[3, 48, 300], ids=lambda n: f"{n} images")
def data(request):
    inputs = inputs_of(request.param)
    return gather(inputs, compute_metrics(inputs))


@pytest.mark.parametrize("kind", FIGURES, ids=lambda kind: kind.name)
def test_every_figure_is_drawn_and_no_two_labels_of_an_axis_overlap(kind, data):
    figure = kind.draw(data)
    assert not isinstance(figure, str)
    figure.canvas.draw()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            boxes = [
                tick.label1.get_window_extent()
                for tick in axis.get_major_ticks()
                if tick.label1.get_text()
                and tick.label1.get_visible()
                and low <= tick.get_loc() <= high
            ]
            for k, box in enumerate(boxes):
                assert not any(box.overlaps(other) for other in boxes[k + 1 :])


def test_a_figure_without_data_says_why():
    for num_images in (0, 1, 2):
        figures = drawn(make_inputs(empty_reconstruction(num_images), names=["a", "b"]))
        absent = {figure.name for figure in figures if figure.png is None}
        assert {"residual_histograms", "visibility", "co_visibility", "matches"} <= absent
        assert all(figure.reason for figure in figures if figure.png is None)


def test_zero_matches_and_zero_residuals_are_drawn():
    rec = make_reconstruction(np.arange(4) * 5.0, sigma_px=(0.0, 0.0))
    pairs = tuple(
        replace(p, num_matches=0, num_static_rejected=0, num_after_affine_ransac=0,
                num_after_distance_filter=0)
        for p in chain_of_pairs(rec.image_names)
    )  # fmt: skip
    figures = {figure.name: figure for figure in drawn(make_inputs(rec, pairs=pairs))}
    for name in ("matches", "residual_histograms", "residual_map"):
        assert figures[name].png is not None
        assert figures[name].png.startswith(PNG)


def test_the_visibility_raster_of_few_tracks_is_the_sorted_matrix():
    rng = np.random.default_rng(0)
    seen = rng.random((6, 40)) < 0.4
    seen[:, 7] = False
    frame, track = np.nonzero(seen)
    first = np.where(seen.any(0), seen.argmax(0), 6)
    last = np.where(seen.any(0), 5 - seen[::-1].argmax(0), -1)
    order = sorted(np.flatnonzero(seen.any(0)), key=lambda j: (first[j], last[j]))
    np.testing.assert_array_equal(visibility_raster(frame, track, 40, 6), seen[:, order])


def test_the_visibility_raster_of_many_tracks_keeps_every_observation():
    rng = np.random.default_rng(0)
    num_tracks = 100_003
    middle = rng.integers(0, 50, num_tracks)
    frame = np.concatenate([middle, np.minimum(middle + 1, 49)])
    track = np.concatenate([np.arange(num_tracks)] * 2)
    raster = visibility_raster(frame, track, num_tracks, 50, max_columns=777)
    assert raster.shape == (50, 777)
    per_column = np.bincount(np.arange(num_tracks) * 777 // num_tracks)
    assert (raster * per_column).sum() == pytest.approx(2 * num_tracks)


def test_figures_of_the_images_say_why_they_are_not_there():
    rec = numbered(make_reconstruction(np.arange(4) * 6.0))
    nothing = gather(inputs := make_inputs(rec), compute_metrics(inputs))
    for draw in (detected_regions, filtered_matches, trajectories):
        assert draw(nothing) == "the images are not at hand"
    for draw in (textured_structure, meshed_surface):
        assert draw(nothing) == "there is no mesh"
    bare = make_inputs(rec, evidence=replace(make_evidence(rec), images={}, pairs=()))
    pixels_alone = gather(bare, compute_metrics(bare))
    assert detected_regions(pixels_alone) == "no keypoints are known"
    assert filtered_matches(pixels_alone) == "no matches are known"
    assert not isinstance(trajectories(pixels_alone), str)


def test_the_matches_figure_has_a_panel_for_each_filter_that_is_known():
    rec = numbered(make_reconstruction(np.arange(4) * 6.0))
    evidence = make_evidence(rec)
    known = gather(inputs := make_inputs(rec, evidence=evidence), compute_metrics(inputs))
    titles = [axes.get_title(loc="left") for axes in filtered_matches(known).axes]
    num = len(evidence.pairs[1].matches)
    assert titles == [
        f"found: {num}", f"after static background: {num}", f"after affine RANSAC: {num}",
        f"after distance filter: {num}",
    ]  # fmt: skip
    pairs = tuple(replace(pair, steps_known=False) for pair in evidence.pairs)
    unknown = make_inputs(rec, evidence=replace(evidence, pairs=pairs))
    figure = filtered_matches(gather(unknown, compute_metrics(unknown)))
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        f"found: {num}", f"verified: {num}",
    ]  # fmt: skip
