import numpy as np

from semsfm_colmap.geometry.rotations import depth_reversed
from semsfm_colmap.refinement.depth_reversal import (
    decide_depth_sign,
    reverse_depth,
    visibility_cues,
)
from semsfm_colmap.synthetic.tracks import simulate_tracks


def test_a_body_has_the_hand_in_which_the_seen_side_is_near_and_its_twin_is_reversed():
    s = simulate_tracks(
        num_images=30,
        range_deg=180,
        num_tracks=3000,
        track_window=8,
        rng=np.random.default_rng(7),
    )
    sizes = np.full((30, 2), 1000)
    for reverse in (False, True):
        cameras, points = reverse_depth(s.cameras, s.points) if reverse else (s.cameras, s.points)
        cues = visibility_cues(cameras, points, s.observations, sizes)
        sign, turn = decide_depth_sign(cues, 0.95)
        assert turn is reverse
        assert sign.status == "resolved"
        assert sign.confidence > 0.99
    assert np.allclose(
        depth_reversed(np.array(reverse_depth(s.cameras, s.points)[0].cam_from_world)),
        s.cameras.cam_from_world,
    )


def test_a_field_that_is_seen_everywhere_leaves_the_hand_open():
    s = simulate_tracks(
        num_images=7, range_deg=30, num_tracks=1000, body="field", rng=np.random.default_rng(3)
    )
    cues = visibility_cues(s.cameras, s.points, s.observations, np.full((7, 2), 1000))
    sign, _ = decide_depth_sign(cues, 0.95)
    assert sign.status == "ambiguous"
    assert "both models" in sign.message
