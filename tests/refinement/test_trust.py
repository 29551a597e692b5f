from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.factorization.blocks import select_blocks
from semsfm_colmap.factorization.degeneracy import diagnose_rank
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.geometry.subset import keep_tracks, take_subset
from semsfm_colmap.mapping import parts as mapping
from semsfm_colmap.mapping.parts import map_observations
from semsfm_colmap.motion.prior import TiltPrior
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.leave_one_out import leave_one_out
from semsfm_colmap.refinement.model_choice import compare_models, held_out_mask
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.types import Observations


def field(num_images=8, range_deg=40.0, seed=0, **options):
    return simulate_tracks(
        num_images=num_images,
        range_deg=range_deg,
        num_tracks=500,
        body="field",
        rng=np.random.default_rng(seed),
        **options,
    )


def mapped(observations: Observations, tilt_deg=None):
    M = observations.num_images
    tilt = None
    if tilt_deg is not None:
        tilt = TiltPrior(
            image_names=tuple(f"{i}.png" for i in range(M)),
            angle_rad=np.deg2rad(np.asarray(tilt_deg, dtype=float)),
            sigma_rad=np.full(M, np.deg2rad(0.1)),
            axis_image_rad=None,
            source="a table",
        )
    return map_observations(
        observations,
        tuple(f"{i}.png" for i in range(M)),
        np.full((M, 2), 1000),
        factorization=FactorizationOptions(),
        refinement=RefinementOptions(),
        tilt=tilt,
    )


def observations_of(points, R, t, noise_px=0.3, seed=0):
    """Every point in every image."""
    M, N = len(R), len(points)
    xy = np.einsum("mij,nj->nmi", R[:, :2], points) + t
    xy += noise_px * np.random.default_rng(seed).normal(size=xy.shape)
    return Observations(
        image_idx=np.tile(np.arange(M), N),
        track_idx=np.repeat(np.arange(N), M),
        keypoint_idx=np.arange(M * N),
        xy=xy.reshape(-1, 2),
        num_images=M,
        num_tracks=N,
    )


def relief(seed=1):
    return np.random.default_rng(seed).uniform(-300, 300, (300, 3)) * [1, 1, 0.3]


def tilts(angles_deg, axis=(0.0, 1.0, 0.0)):
    return rotation_from_vector(np.deg2rad(np.asarray(angles_deg))[:, None] * np.array(axis))


SHIFTS = np.array([[500.0, 500.0], [520.0, 480.0], [470.0, 510.0], [490.0, 530.0]])


@pytest.mark.parametrize(
    ("name", "points", "R", "tilt_deg", "status", "word"),
    [
        (
            "pure translation",
            relief(),
            tilts([0, 0, 0, 0]),
            None,
            "pure_translation",
            "differ by a shift at most",
        ),
        (
            "in-plane rotation only",
            relief(),
            tilts([0, 20, 40, 60], (0, 0, 1.0)),
            None,
            "in_plane_rotation",
            "a rotation in the image plane of up to 60.0 deg",
        ),
        (
            "all tilts equal",
            relief(),
            tilts([30, 30, 30, 30]),
            [30, 30, 30, 30],
            "equal_tilts",
            "the same tilt of 30.0 deg",
        ),
        (
            "planar specimen",
            relief() * [1, 1, 0],
            tilts([0, 10, 20, 30]),
            None,
            "planar",
            "the specimen is flat",
        ),
    ],
)
def test_series_without_depth_are_refused_by_name(name, points, R, tilt_deg, status, word):
    result = mapped(observations_of(points, R, SHIFTS), tilt_deg)
    assert result.value is None, name
    assert result.status == status
    assert word in result.message
    assert "tilt" in result.message


def test_two_views_and_tracks_of_length_two_are_refused_by_name():
    two = mapped(observations_of(relief(), tilts([0, 10]), SHIFTS[:2]))
    assert two.status == "two_views"
    assert "only two images share tracks" in two.message
    obs = field().observations
    second = np.zeros(len(obs), dtype=bool)
    for j in range(obs.num_tracks):
        rows = np.flatnonzero(obs.track_idx == j)
        second[rows[j % 7 : j % 7 + 2]] = True
    pairs = mapped(obs.select(second))
    assert pairs.status == "tracks_of_length_two"
    assert "every track is seen in two images only" in pairs.message


def test_a_repeated_picture_is_named_and_the_rest_goes_on():
    R = tilts([0, 10, 20, 20, 30])
    t = np.concatenate([SHIFTS, SHIFTS[3:]])
    t[3] = t[2]
    obs = observations_of(relief(), R, t)
    # a second exposure of the same view has noise of its own and is no repetition
    again = mapped(obs)
    assert again.status == "ok"
    assert again.value[0].reconstruction.num_images == 5
    xy = np.array(obs.xy)
    xy[obs.image_idx == 3] = xy[obs.image_idx == 2]
    repeated = mapped(replace(obs, xy=xy))
    assert repeated.value[0].reconstruction.num_images == 5
    assert repeated.status == "duplicated_image"
    assert any("2.png = 3.png" in n for n in repeated.value[0].figures.notes)


def test_an_image_without_tracks_is_named_and_the_rest_goes_on():
    obs = field().observations
    lost = mapped(obs.select(obs.image_idx != 4))
    assert lost.status == "image_without_tracks"
    assert any("no track with any other: 4.png" in n for n in lost.value[0].figures.notes)
    names = lost.value[0].reconstruction.image_names
    assert names == tuple(f"{i}.png" for i in range(8) if i != 4)


def test_two_components_give_two_models():
    s = simulate_tracks(
        num_images=14, range_deg=80, num_tracks=3000, track_window=4, rng=np.random.default_rng(0)
    )
    obs = s.observations
    left = np.isin(obs.track_idx, np.unique(obs.track_idx[obs.image_idx < 7]))
    right = np.isin(obs.track_idx, np.unique(obs.track_idx[obs.image_idx >= 7]))
    result = mapped(obs.select(left != right))
    assert [p.reconstruction.num_images for p in result.value] == [7, 7]
    both = {n for p in result.value for n in p.reconstruction.image_names}
    assert len(both) == 14
    assert result.status == "several_parts"


def test_a_total_tilt_of_one_degree_is_refused_where_the_noise_hides_it():
    obs = field(num_images=4, range_deg=1.0, wobble_deg=0.0).observations
    blind = mapped(obs)
    assert blind.status == "pure_translation"
    assert "a tilt so small that the noise hides it" in blind.message
    recorded = mapped(obs, np.linspace(0.0, 1.0, 4))
    assert recorded.status == "tilt_too_small"
    assert "span 1.0 deg only" in recorded.message


def test_a_total_tilt_of_one_degree_has_its_own_sentence_where_the_relief_is_deep():
    deep = relief() * [1, 1, 3]
    obs = observations_of(deep, tilts([0, 0.3, 0.7, 1.0]), SHIFTS)
    refused = mapped(obs)
    assert refused.status == "tilt_too_small"
    assert "viewing directions differ by" in refused.message
    # the tilt is seen in second order: at twice as much the shape comes out, with a warning
    wanted = mapped(observations_of(deep, tilts([0, 0.6, 1.4, 2.0]), SHIFTS))
    assert wanted.status == "small_rotation"
    notes = wanted.value[0].figures.notes
    assert any("total rotation is only" in n for n in notes)


def test_rank_diagnosis_sees_depth_where_there_is_some():
    blocks = select_blocks(field().observations, FactorizationOptions())
    assert diagnose_rank(blocks).status == "ok"


def ladder(s, **options):
    return compare_models(s.cameras, s.observations, BundleSettings(**options))


def test_models_agree_at_a_large_tilt_and_differ_at_a_small_one_with_drifting_magnification():
    large = ladder(field(range_deg=60.0))
    assert "agree" in large.message
    assert "disagree" not in large.message
    small = field(num_images=5, range_deg=10.0, wobble_deg=0.0)
    drift = np.exp(0.003 * np.linspace(-1, 1, 5) ** 2)
    centre = small.cameras.translation_px[small.observations.image_idx]
    xy = centre + drift[small.observations.image_idx, None] * (small.observations.xy - centre)
    drifting = replace(small, observations=replace(small.observations, xy=xy))
    rungs = {r.name: r for r in ladder(drifting).rungs}
    assert abs(rungs["orthographic"].range_deg - 10.0) > 1.0
    assert rungs["orthographic"].held_out_px > 1.05 * rungs["scaled, free"].held_out_px
    # with three views nothing can be held out: the BIC rules out the model that is wrong
    obs = drifting.observations
    three = obs.image_idx % 2 == 0
    local = take_subset(obs, images=np.array([0, 2, 4]), mask=three).observations
    few = replace(
        drifting, observations=local, cameras=drifting.cameras.select(np.array([0, 2, 4]))
    )
    comparison = ladder(few)
    assert "orthographic" not in comparison.alive
    assert {"scaled, prior", "scaled, free"} <= set(comparison.alive)


def test_bic_prefers_the_simple_model_on_simple_data_and_the_scaled_one_on_scaled_data():
    assert ladder(field(seed=3)).best == "orthographic"
    scaled = ladder(field(seed=3, scale_drift=0.01), scale_sigma=0.01)
    assert scaled.best.startswith("scaled")


def test_at_most_one_observation_of_a_long_track_is_held_out():
    obs = field().observations
    mask = held_out_mask(obs)
    assert 0 < mask.sum() <= obs.num_tracks
    assert np.bincount(obs.track_idx[mask]).max() == 1


def test_leaving_one_out_shows_an_image_that_drags_the_others():
    s = field(num_images=6)
    calm = leave_one_out(s.cameras, s.observations, BundleSettings())
    # image 2 sheared by one percent
    xy = np.array(s.observations.xy)
    rows = s.observations.image_idx == 2
    xy[rows, 0] += 0.01 * (xy[rows, 1] - 500)
    bad = leave_one_out(s.cameras, replace(s.observations, xy=xy), BundleSettings())
    assert calm.jackknife_deg < 0.1
    assert bad.change_deg[2] > 3 * calm.change_deg[2]
    three = s.cameras.select(np.arange(3))
    assert leave_one_out(three, s.observations, BundleSettings()) is None


def test_an_image_that_cannot_be_left_out_does_not_shift_the_labels_of_the_others():
    s = field(num_images=8)
    obs = s.observations
    # tracks of the last image reach one other image only
    keep = (obs.image_idx != 7) | (obs.track_idx < 40)
    keep &= ~((obs.track_idx < 40) & ~np.isin(obs.image_idx, (6, 7)))
    s = replace(s, observations=keep_tracks(obs, keep, min_length=2)[0])
    found = leave_one_out(s.cameras, s.observations, BundleSettings())
    # without image 6 image 7 is not seen twice by any track, so that image 6 is not left out
    assert found.images.tolist() == [0, 1, 2, 3, 4, 5, 7]
    assert len(found.change_deg) == 7


def test_a_series_that_hangs_together_weakly_says_so(monkeypatch):
    obs = field().observations
    said = [mapped(obs).value[0].figures.notes]
    monkeypatch.setattr(mapping, "WEAK_GAP", np.inf)
    said.append(mapped(obs).value[0].figures.notes)
    assert [any("weakly" in n for n in notes) for notes in said] == [False, True]
