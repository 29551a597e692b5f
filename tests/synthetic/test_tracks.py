import numpy as np
import pytest

from semsfm_colmap.synthetic.tracks import simulate_tracks


def simulated(body, visible_deg):
    return simulate_tracks(
        num_images=9,
        range_deg=120.0,
        num_tracks=200,
        noise_px=0.0,
        body=body,
        visible_deg=visible_deg,
        rng=np.random.default_rng(0),
    )


@pytest.mark.parametrize("body", ["body", "field"])
def test_points_are_seen_within_the_angle_of_their_normals(body):
    s = simulated(body, 50.0)
    normals = np.tile([0.0, 0.0, -1.0], (len(s.points), 1))
    if body == "body":
        normals = s.points / np.linalg.norm(s.points, axis=1, keepdims=True)
    toward = -normals @ s.cameras.viewing_direction.T
    seen = np.zeros_like(toward, dtype=bool)
    seen[s.observations.track_idx, s.observations.image_idx] = True
    np.testing.assert_array_equal(seen, toward >= np.cos(np.deg2rad(50.0)))


def test_without_an_angle_a_field_is_always_seen_and_a_body_up_to_78_degrees():
    field = simulated("field", None)
    assert len(field.observations) == 9 * 200
    body, same = simulated("body", None), simulated("body", np.rad2deg(np.arccos(0.2)))
    np.testing.assert_array_equal(body.observations.xy, same.observations.xy)
