from dataclasses import replace

import numpy as np

from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.tracks.diagnosis import diagnose_tracks


def scene(**options):
    return simulate_tracks(
        num_images=6,
        range_deg=40,
        num_tracks=300,
        body="field",
        rng=np.random.default_rng(0),
        **options,
    ).observations


def test_an_ordinary_series_has_nothing_to_be_said_of():
    found = diagnose_tracks(scene())
    assert found.num_images == 6
    assert found.longest == 6
    assert found.notes([f"{i}.png" for i in range(6)]) == {}


def test_a_copy_is_found_through_the_rounding_of_its_keypoints():
    obs = scene()
    xy = np.array(obs.xy)
    rounding = 0.01 * np.random.default_rng(1).uniform(-1, 1, (300, 2))
    xy[obs.image_idx == 4] = xy[obs.image_idx == 1] + rounding
    found = diagnose_tracks(replace(obs, xy=xy))
    assert found.repeated == ((1, 4),)
    assert "1.png = 4.png" in found.notes([f"{i}.png" for i in range(6)])["duplicated_image"]


def test_an_image_whose_tracks_end_in_it_shares_none():
    obs = scene()
    alone = obs.image_idx == 2
    track = np.where(alone, obs.num_tracks + np.cumsum(alone), obs.track_idx)
    order = np.argsort(track, kind="stable")
    lonely = replace(
        obs,
        image_idx=obs.image_idx[order],
        xy=obs.xy[order],
        keypoint_idx=obs.keypoint_idx[order],
        track_idx=np.unique(track[order], return_inverse=True)[1],
        num_tracks=len(np.unique(track)),
    )
    found = diagnose_tracks(lonely)
    assert found.without_tracks == (2,)
    assert "2.png" in found.notes([f"{i}.png" for i in range(6)])["image_without_tracks"]
