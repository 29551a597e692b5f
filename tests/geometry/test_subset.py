import numpy as np

from semsfm_colmap.geometry.subset import keep_tracks, thin_evenly
from semsfm_colmap.synthetic.tracks import simulate_tracks


def scene():
    return simulate_tracks(
        num_images=12,
        range_deg=90,
        num_tracks=3000,
        track_window=5,
        rng=np.random.default_rng(0),
    ).observations


def test_thinned_tracks_leave_every_image_what_it_asks_for():
    obs = scene()
    # one image is poor: all its tracks must stay
    poor = (obs.image_idx == 4) & (obs.track_idx % 20 != 0)
    obs, _ = keep_tracks(obs, ~poor, min_length=2)
    before = np.bincount(obs.image_idx, minlength=12)
    keep = thin_evenly(obs, 150)
    thin = obs.select(keep[obs.track_idx])
    after = np.bincount(thin.image_idx, minlength=12)
    assert before[4] < 150
    assert after[4] == before[4]
    assert (after >= 0.8 * np.minimum(before, 150)).all()
    assert len(thin) < 0.5 * len(obs)


def test_few_tracks_are_not_thinned():
    obs = scene()
    assert thin_evenly(obs, 10**6).all()
