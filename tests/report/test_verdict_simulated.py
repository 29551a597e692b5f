"""The verdict on series that were simulated, mapped and measured like any."""

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.subset import keep_tracks
from semsfm_colmap.mapping.parts import map_observations
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.report.metrics import compute_metrics
from semsfm_colmap.report.verdict import judge
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.report.series import make_inputs, written
from tests.report.test_verdict import titles

SIZE_PX = 1000


def mapped(observations, *, pixel_size_um=0.05, names=None):
    """Verdict and notes of a series of observations."""
    names = names or tuple(f"{i:02d}.png" for i in range(observations.num_images))
    end = map_observations(
        observations,
        names,
        np.full((len(names), 2), SIZE_PX),
        factorization=FactorizationOptions(),
        refinement=RefinementOptions(depth_sign="as_is"),
        pixel_size_um=pixel_size_um,
        pixel_size_source="none" if pixel_size_um is None else "a test",
    )
    assert end.value is not None, end.message
    models = tuple(
        replace(written(), model=f"sparse/{k}", part=k, images=part.reconstruction.image_names)
        for k, part in enumerate(end.value)
    )
    first = end.value[0]
    inputs = make_inputs(
        first.reconstruction,
        names=names,
        models=models,
        reliability=first.figures.reliability,
        notes=first.figures.notes,
    )
    return judge(compute_metrics(inputs))


def turned(range_deg, **options):
    defaults = {"num_images": 12, "num_tracks": 900, "noise_px": 0.15, "wobble_deg": 0.1}
    return simulate_tracks(
        range_deg=range_deg, rng=np.random.default_rng(4), **{**defaults, **options}
    )


@pytest.fixture(scope="module")
def good():
    return turned(60.0)


def test_a_good_series_leaves_no_doubt(good):
    result = mapped(good.observations)
    assert result.doubts == ()
    assert "a length that you know" in result.next[0]


def test_without_a_pixel_size_the_same_series_lacks_nothing_else(good):
    assert titles(mapped(good.observations, pixel_size_um=None)) == [
        "no pixel size: lengths are in px"
    ]


def test_a_tilt_of_eight_degrees_is_too_small():
    found = titles(mapped(turned(8.0, body="field").observations))
    assert any(title.startswith("the specimen turned by only") for title in found)


def test_a_magnification_that_runs_with_the_angle_is_found_and_its_scatter_is_not(good):
    obs, t = good.observations, np.asarray(good.cameras.translation_px)

    def magnified(factor):
        xy = t[obs.image_idx] + (obs.xy - t[obs.image_idx]) * factor[obs.image_idx, None]
        return titles(mapped(replace(obs, xy=xy)))

    ramp = np.linspace(-0.5, 0.5, obs.num_images)
    assert any("runs with the angle by 1.0" in title for title in magnified(1.0 + 0.01 * ramp))
    assert magnified(1.0 + 0.002 * ramp) == []
    shuffled = 1.0 + 0.005 * np.random.default_rng(1).permutation(ramp)
    assert magnified(shuffled) == []


def test_two_halves_that_share_nothing_are_two_models():
    obs = turned(80.0, num_images=14, num_tracks=1600).observations
    late = obs.image_idx >= 8
    # each track keeps the half in which it is seen more often
    num_late = np.bincount(obs.track_idx, weights=late, minlength=obs.num_tracks)
    mostly = 2.0 * num_late > np.bincount(obs.track_idx, minlength=obs.num_tracks)
    apart = keep_tracks(obs, late == mostly[obs.track_idx], min_length=2)[0]
    result = mapped(apart)
    (doubt,) = [doubt for doubt in result.doubts if "falls into" in doubt.title]
    assert "07.png – 08.png" in doubt.action
    assert not any("could not be registered" in title for title in titles(result))
