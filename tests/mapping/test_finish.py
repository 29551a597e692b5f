from types import SimpleNamespace

import numpy as np

from semsfm_colmap.mapping.finish import find_cues
from semsfm_colmap.refinement.depth_reversal import CUES, SHAPE_CUES, visibility_cues
from semsfm_colmap.synthetic.tracks import simulate_tracks


def model_of(series, num_tracks):
    observations = series.observations.select(series.observations.track_idx < num_tracks)
    return SimpleNamespace(
        images=np.arange(len(series.cameras)),
        cameras=series.cameras,
        points=series.points[:num_tracks],
        observations=observations,
    )


def test_the_shape_is_judged_on_the_last_model_and_what_hides_what_on_the_first():
    series = simulate_tracks(
        num_images=12,
        range_deg=90,
        num_tracks=3000,
        track_window=6,
        rng=np.random.default_rng(7),
    )
    first, last = model_of(series, 400), model_of(series, 3000)
    sizes = np.full((12, 2), 1000)
    context = SimpleNamespace(
        image_size_px=sizes, tilt=None, refinement=SimpleNamespace(receding_edge="unknown")
    )
    cues = find_cues(context, last, first)
    assert tuple(cues) == tuple(CUES)
    for name, cue in cues.items():
        model = last if name in SHAPE_CUES else first
        alone = visibility_cues(model.cameras, model.points, model.observations, sizes)[name]
        assert (cue.t, cue.probability) == (alone.t, alone.probability)
    on_first = visibility_cues(first.cameras, first.points, first.observations, sizes)
    assert cues["bulge"].t > on_first["bulge"].t > 0.0
