from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.frames import order_frames
from semsfm_colmap.report.metrics import compute_metrics
from semsfm_colmap.report.structure_statistics import co_visibility, structure_statistics
from tests.report.series import full_inputs, make_inputs, make_reconstruction, poses


def test_rejected_observations_count_as_rejected_and_nowhere_else():
    rec = make_reconstruction(np.arange(6) * 4.0, num_points=100)
    inlier = np.ones(len(rec.inlier), dtype=np.bool_)
    inlier[::5] = False
    xy = np.array(rec.observations.xy)
    xy[~inlier] += 500.0
    rec = replace(rec, inlier=inlier, observations=replace(rec.observations, xy=xy))
    m = compute_metrics(make_inputs(rec))
    assert m.structure.num_observations == int(inlier.sum())
    assert m.structure.rejected_fraction == pytest.approx(float((~inlier).mean()))
    assert m.residuals.max_error_px < 5.0
    assert sum(pose.num_rejected_observations for pose in poses(m)) == int((~inlier).sum())


def test_track_lengths_are_counted():
    rec = make_reconstruction(np.arange(5) * 4.0, num_points=10, window=1)
    s = structure_statistics(rec)
    # of ten points, two belong to either end of the series (2 images) and six do not (3 images)
    assert s.track_length_counts == (0, 0, 4, 6)
    assert s.mean_track_length == pytest.approx(2.6)
    assert s.median_track_length == 3.0
    assert s.num_points_in_3_or_more_images == 6


def test_co_visibility_agrees_with_counting_one_by_one():
    rec = make_reconstruction(np.arange(7) * 4.0, num_points=60, window=2)
    inlier = np.random.default_rng(1).random(len(rec.inlier)) > 0.3
    rec = replace(rec, inlier=inlier)
    seen = [
        set(rec.observations.track_idx[(rec.observations.image_idx == i) & inlier].tolist())
        for i in range(7)
    ]
    expected = [[len(a & b) for b in seen] for a in seen]
    shared = co_visibility(rec, order_frames(make_inputs(rec)))
    assert shared.num_shared_tracks.tolist() == expected


def test_co_visibility_keeps_the_numbers_of_the_frames():
    rec = make_reconstruction(np.arange(3) * 4.0)
    a, b, c = rec.image_names
    frames = order_frames(make_inputs(rec, names=[a, "lost 1.png", b, c, "lost 2.png"]))
    assert co_visibility(rec, frames).frames.tolist() == [1, 3, 4]


def test_the_point_sigma_is_the_expected_distance():
    sigma = structure_statistics(full_inputs().reconstruction).sigma
    assert sigma is not None
    assert sigma.median_point_sigma_world == pytest.approx(np.sqrt(0.03))


def test_points_without_a_covariance_have_no_sigma():
    assert structure_statistics(make_reconstruction(np.arange(3) * 4.0)).sigma is None
