from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.figure_style import gather
from semsfm_colmap.report.figures_progress import filtered, structure_progress, triangulated
from semsfm_colmap.report.metrics import compute_metrics
from tests.report.images.evidence import make_evidence, numbered
from tests.report.series import make_inputs, make_reconstruction


@pytest.fixture(scope="module")
def rec():
    return numbered(make_reconstruction(np.arange(6) * 8.0, window=2, sigma_px=(0.1, 0.1)))


def spoilt(rec, rows):
    xy = rec.observations.xy.copy()
    xy[rows] += [40.0, 0.0]
    return replace(rec.observations, xy=xy)


def test_the_point_of_a_track_is_the_least_squares_one(rec):
    obs = rec.observations
    X = triangulated(rec.cameras, obs.image_idx, obs.track_idx, obs.xy, obs.num_tracks)
    rows = np.flatnonzero(obs.track_idx == 7)
    P = rec.cameras.projection[obs.image_idx[rows]].reshape(-1, 3)
    b = (obs.xy[rows] - rec.cameras.translation_px[obs.image_idx[rows]]).ravel()
    np.testing.assert_allclose(X[7], np.linalg.lstsq(P, b)[0], atol=1e-9)
    assert np.linalg.norm(X - rec.points, axis=1).max() < 0.3


def test_a_track_of_one_image_has_no_point(rec):
    obs = rec.observations.select(rec.observations.image_idx == 2)
    X = triangulated(rec.cameras, obs.image_idx, obs.track_idx, obs.xy, obs.num_tracks)
    assert np.isnan(X).all()


def test_filtering_drops_what_is_wrong_and_keeps_the_rest(rec):
    wrong = np.flatnonzero(rec.observations.image_idx == 5)[:20]
    obs = spoilt(rec, wrong)
    X, keep = filtered(
        rec.cameras, obs.image_idx, obs.track_idx, obs.xy, obs.num_tracks, (8.0, 4.0, 2.0, 1.0)
    )
    assert not keep[wrong].any()
    untouched = ~np.isin(obs.track_idx, obs.track_idx[wrong])
    assert keep[untouched].all()
    known = np.isfinite(X).all(axis=1)
    assert np.linalg.norm((X - rec.points)[known], axis=1).max() < 0.3


def test_the_panels_count_their_points(rec):
    evidence = make_evidence(rec)
    inputs = make_inputs(rec, evidence=evidence)
    figure = structure_progress(gather(inputs, compute_metrics(inputs)))
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles == [
        "all tracks: 400 points", "within 1 px: 400 points", "the model: 400 points"
    ]  # fmt: skip
    bare = make_inputs(rec, evidence=replace(evidence, tracks=None))
    assert structure_progress(gather(bare, compute_metrics(bare))) == "the tracks are not at hand"
