"""The public function behind `semsfm plan`."""

import pytest

import semsfm_colmap
from semsfm_colmap.config import config_from_dict, write_config
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.pipeline.plan import plan, priors_of
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.planning.options import GivenNoise, NextOptions, SpecimenOptions
from tests.exports.ball_project import NOISE_PX, write_project

ONE = NextOptions(num_added=1, candidate_step_deg=40.0)
FIELD = SpecimenOptions(specimen="field", max_total_deg=30.0, max_frames=9)


@pytest.fixture
def project(tmp_path):
    return write_project(tmp_path / "project", special=False)


def test_it_is_a_public_name():
    assert semsfm_colmap.plan is plan


def test_one_series_is_answered_in_text_numbers_and_a_figure():
    answer = plan(num_frames=7, total_deg=30.0, pixel_size_um=0.5, specimen=FIELD)
    (numbers,) = answer.numbers()
    assert numbers["depth_sigma_um"] == pytest.approx(0.5 * numbers["depth_sigma_px"])
    assert f"{numbers['depth_sigma_px']:.3f}" in answer.text()
    assert answer.figure().axes


def test_series_that_reach_a_sigma_reach_it_with_the_noise_given():
    quiet = plan(depth_sigma_px=0.6, specimen=FIELD, noise=GivenNoise(noise_px=0.1))
    usual = plan(depth_sigma_px=0.6, specimen=FIELD)
    assert quiet.series[0].size.num_frames <= usual.series[0].size.num_frames
    for answer in (quiet, usual):
        assert all(s.prediction.median_px <= 0.6 for s in answer.series)
    with pytest.raises(InputError, match="no series within the limits reaches"):
        plan(depth_sigma_px=0.6, specimen=FIELD, noise=GivenNoise(noise_px=2.0))


def test_a_project_brings_its_noise_and_its_priors(project):
    write_config(
        config_from_dict({"refinement": {"scale_sigma": 0.004, "drift_sigma_px": 0.3}}),
        Project(project).config,
    )
    noise = plan(project, add=ONE).mapped.noise
    assert noise.noise_px == pytest.approx(NOISE_PX, rel=0.1)
    assert (noise.scale_sigma, noise.drift_sigma_px) == (0.004, 0.3)
    text = plan(project, add=ONE).text()
    assert "magnification 0.4 %" in text
    assert "drift 0.3 px" in text


def test_of_images_that_were_not_scanned_no_drift_is_reckoned_with(project):
    write_config(config_from_dict({"refinement": {"scanned": "no"}}), Project(project).config)
    assert priors_of(Project(project)).drift_sigma_px == 0.0


def test_what_is_given_goes_before_what_the_project_brings(project):
    own = plan(project, add=ONE)
    noisy = plan(project, add=ONE, noise=GivenNoise(noise_px=2.0 * own.mapped.noise.noise_px))
    assert noisy.mapped.noise.noise_px == 2.0 * own.mapped.noise.noise_px
    # priors stay, so that the sigmas do not quite double
    ratio = noisy.found.before.mean_px / own.found.before.mean_px
    assert 1.5 < ratio <= 2.0
    loose = plan(project, add=ONE, noise=GivenNoise(scale_sigma=0.05, drift_sigma_px=2.0))
    assert loose.mapped.noise.noise_px == own.mapped.noise.noise_px
    assert loose.found.before.mean_px > own.found.before.mean_px


def test_two_questions_at_once_are_none(project):
    with pytest.raises(UsageError, match="give one of"):
        plan(project, num_frames=5, total_deg=30.0)
    with pytest.raises(UsageError, match="give one of"):
        plan()
    with pytest.raises(UsageError, match="noise_px of the given noise options is nan"):
        plan(project, noise=GivenNoise(noise_px=float("nan")))
