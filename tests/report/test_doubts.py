"""Every threshold of the verdict from both sides, and what each doubt recommends."""

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.mapping.drift import drift_notes
from semsfm_colmap.mapping.perspective import perspective_notes
from semsfm_colmap.records import DragFigures, PerspectiveFigures, Rung, ScanDriftFigures
from semsfm_colmap.refinement.magnification import magnification_notes
from semsfm_colmap.refinement.trust import reliability_notes
from semsfm_colmap.report.magnification_trend import magnification_trend
from semsfm_colmap.report.metrics import compute_metrics
from semsfm_colmap.report.verdict import judge
from semsfm_colmap.types import DepthSign
from tests.report.series import make_inputs, make_reconstruction, written
from tests.report.test_verdict import ANGLES, facts, judged, titles, trusted, verdict, with_tilts


def with_scale(relative, angles=ANGLES):
    rec = make_reconstruction(angles)
    return replace(rec, cameras=replace(rec.cameras, scale_px_per_unit=20.0 * np.asarray(relative)))


def running(span):
    """Magnifications that run with the angle of `ANGLES`, with a tenth of scatter."""
    scatter = 0.1 * np.array([1, -1, -0.3, 0.7, -0.8, 0.9, -0.2, 0.4, 0.6, -0.9])
    return 1.0 + span * (np.linspace(-0.5, 0.5, 10) + 0.5 * scatter)


@pytest.mark.parametrize(("span", "doubted"), [(0.0025, False), (0.0036, True)])
def test_a_magnification_that_runs_with_the_angle_is_doubted_beyond_what_microscopes_do(
    span, doubted
):
    result = judged(trusted(), with_scale(running(span)))
    assert [t for t in titles(result) if "runs with the angle" in t] == titles(result)
    assert len(result.doubts) == doubted
    assert ("no more than that of a microscope may" in facts(result)) == (not doubted)
    if doubted:
        assert "orthographic" in result.doubts[0].action
        assert "known tilts" in result.doubts[0].action


def test_a_smaller_run_is_doubted_where_the_angles_hang_on_it():
    rec = with_scale(running(0.0015))
    held = judged(trusted(sigma_deg=0.2, depth_uncertainty=0.004), rec)
    assert held.doubts == ()
    beyond = judged(trusted(sigma_deg=0.1, depth_uncertainty=0.004), rec)
    assert titles(beyond) == ["the magnification runs with the angle by 0.15\u202f%"]
    assert "differ by 0.40\u202f% in the angles" in beyond.doubts[0].sentence


def test_scatter_of_the_same_size_is_no_run():
    scatter = np.array([1, -1, -0.3, 0.7, -0.8, 0.9, -0.2, 0.4, 0.6, -0.9])
    result = judged(trusted(), with_scale(1.0 + 0.0025 * scatter))
    assert result.doubts == ()
    assert "runs with the angle" not in facts(result)


def test_scatter_passes_for_a_run_as_often_as_it_is_allowed_to():
    rng = np.random.default_rng(0)
    angle = np.arange(12) * 4.0
    found = [magnification_trend(angle, rng.normal(size=12)) for _ in range(20_000)]
    share = np.mean([trend.is_found for trend in found])
    assert 0.0004 < share < 0.0018


def test_a_run_that_is_even_in_the_angle_is_found_and_few_images_say_nothing():
    angle = np.linspace(-30.0, 30.0, 11)
    trend = magnification_trend(angle, 1.0 + 1e-5 * (angle / 6.0) ** 2)
    assert trend.is_found
    assert trend.span == pytest.approx(25e-5, rel=1e-6)
    assert magnification_trend(angle[:5], 1.0 + 1e-3 * angle[:5]) is None
    assert magnification_trend(np.zeros(8), np.ones(8)) is None
    still = magnification_trend(angle, np.ones(11))
    assert not still.is_found


def drifting(largest_px):
    return replace(trusted(), drift_px={"a": (0.1, -largest_px), "b": (0.02, 0.05)})


@pytest.mark.parametrize(("largest_px", "doubted"), [(0.45, False), (0.6, True)])
def test_a_drift_of_more_than_half_a_pixel_is_a_doubt_and_no_note(largest_px, doubted):
    result = judged(drifting(largest_px))
    assert len(result.doubts) == doubted
    notes = tuple(drift_notes(np.array([[0.1, -largest_px]])))
    assert len(notes) == 1
    assert result.not_said(notes) == ()
    said = " ".join(doubt.sentence for doubt in result.doubts) if doubted else facts(result)
    assert f"{largest_px:.2f} px" in said
    if doubted:
        assert "scan faster" in result.doubts[0].action


def test_a_drift_that_was_left_in_is_doubted_whatever_its_size():
    left = replace(trusted(), scan_drift=ScanDriftFigures(largest_px=0.3, best=True))
    (doubt,) = judged(left).doubts
    assert "left in the frames" in doubt.title
    assert (
        judged(replace(left, scan_drift=ScanDriftFigures(largest_px=0.3, best=False))).doubts == ()
    )


@pytest.mark.parametrize(("range_deg", "doubted"), [(14.4, True), (16.2, False)])
def test_a_rotation_below_fifteen_degrees_is_doubted(range_deg, doubted):
    angles = np.linspace(0.0, range_deg, 10)
    result = verdict(make_reconstruction(angles))
    assert len(result.doubts) == doubted
    if doubted:
        assert "--tilt_step_deg" in result.doubts[0].action


def test_a_small_rotation_is_one_doubt_with_its_error_bar_not_two():
    rec = make_reconstruction(np.linspace(0.0, 9.0, 10))
    result = judged(trusted(total_deg=9.0, sigma_deg=0.4), rec)
    assert titles(result) == ["the specimen turned by only 9.0 ± 0.4 deg"]
    assert "uncertain by 4.4\u202f%" in result.doubts[0].sentence


def test_a_small_rotation_that_recorded_tilts_confirm_is_no_doubt_by_itself():
    inputs = with_tilts(np.linspace(-5.0, 5.0, 9), slope=1.0, sigma_deg=0.05)
    assert inputs.tilt.consistent
    assert judge(compute_metrics(inputs)).doubts == ()
    uncertain = replace(inputs, reliability=trusted(total_deg=10.0, sigma_deg=0.5))
    assert titles(judge(compute_metrics(uncertain))) == [
        "the total rotation is uncertain by 5.0\u202f%"
    ]


@pytest.mark.parametrize(("sigma_deg", "doubted"), [(0.35, False), (0.37, True)])
def test_a_total_rotation_is_doubted_from_one_percent_on(sigma_deg, doubted):
    result = judged(trusted(sigma_deg=sigma_deg, drag=sigma_deg))
    assert len(result.doubts) == doubted
    assert ("more images do not help" in " ".join(result.next)) == doubted
    assert "noise alone would be ± 0.01°" in facts(result)


@pytest.mark.parametrize(
    ("cause", "cure"),
    [("noise", "add images"), ("clustered", "more of the surface"), ("perspective", "distance")],
)
def test_what_is_to_be_done_follows_from_the_largest_part(cause, cure):
    (doubt,) = judged(trusted(sigma_deg=1.0, **{cause: 1.0})).doubts
    assert cure in doubt.action


@pytest.mark.parametrize(("spread", "doubted"), [(0.009, False), (0.012, True)])
def test_camera_models_are_doubted_from_one_percent_on(spread, doubted):
    assert len(judged(trusted(depth_uncertainty=spread)).doubts) == doubted


def test_merged_series_without_a_common_axis_are_not_taken_for_still_ones():
    inputs = make_inputs(make_reconstruction(ANGLES))
    metrics = compute_metrics(replace(inputs, reliability=trusted(total_deg=80.0)))
    assert judge(replace(metrics, rotation=None)).doubts == ()


def part(model, images, kind="model"):
    return replace(written(kind), model=model, images=tuple(images), num_images=len(images))


def test_a_series_in_two_models_names_the_gap_and_calls_no_image_lost():
    rec = make_reconstruction(ANGLES)
    names = [*rec.image_names, "late 0.png", "late 1.png", "late 2.png"]
    models = (part("sparse/0", rec.image_names), part("sparse/1", names[10:]))
    result = verdict(rec, names=names, models=models)
    assert titles(result) == ["the series falls into 2 models"]
    (doubt,) = result.doubts
    assert "sparse/0 has 10, sparse/1 has 3 of 13 images" in doubt.sentence
    assert "frame_009.png – late 0.png" in doubt.action
    notes = ("the series falls into 2 parts that", "3 of 13 images could not be registered: a")
    assert result.not_said((*notes, "another")) == ("another",)


def test_a_twin_is_no_second_part():
    rec = make_reconstruction(ANGLES)
    models = (part("sparse/0", rec.image_names), part("sparse/1", rec.image_names, "twin"))
    assert verdict(rec, models=models).doubts == ()


def test_without_a_pixel_size_no_number_is_in_micrometres():
    rec = make_reconstruction(ANGLES, world_unit="px", pixel_size_um=None, pixel_size_source="none")
    result = verdict(rec)
    assert titles(result) == ["no pixel size: lengths are in px"]
    for option in ("--pixel_size_um", "--scale_bar_um"):
        assert option in result.doubts[0].action
    said = facts(result)
    assert "µm" not in said
    assert " nm" not in said
    assert "in pixels" in said


def hand(confidence, status="resolved", **cues):
    return DepthSign(status=status, confidence=confidence, evidence=cues)


@pytest.mark.parametrize(
    ("confidence", "shown"),
    [(0.9612, "96\u202f%"), (0.9877, "99\u202f%"), (0.9998, "above 99\u202f%")],
)
def test_a_confidence_is_told_no_finer_than_it_is_calibrated(confidence, shown):
    result = verdict(make_reconstruction(ANGLES, depth_sign=hand(confidence, steps=confidence)))
    assert f"with {shown} confidence" in facts(result)
    assert "99.9" not in facts(result)


def test_a_hand_that_only_convexity_decides_says_so():
    bulging = {"near side": 0.95, "bulge": 0.96}
    rec = make_reconstruction(ANGLES, depth_sign=hand(0.96, **bulging))
    assert "of a hollow one" in facts(verdict(rec))
    stepped = make_reconstruction(ANGLES, depth_sign=hand(0.99, **bulging, steps=0.97))
    assert "of a hollow one" not in facts(verdict(stepped))


def test_an_open_hand_asks_for_the_receding_edge_only_where_tilts_are_recorded():
    open_ = hand(0.5, "ambiguous")
    (doubt,) = verdict(make_reconstruction(ANGLES, depth_sign=open_)).doubts
    assert "--depth_sign as_is" in doubt.action
    assert "receding_edge" not in doubt.action
    inputs = with_tilts(ANGLES, slope=1.0, sigma_deg=0.2)
    inputs = replace(inputs, reconstruction=replace(inputs.reconstruction, depth_sign=open_))
    (doubt,) = judge(compute_metrics(inputs)).doubts
    assert "receding_edge" in doubt.action


def test_a_word_against_the_evidence_is_a_doubt_about_everything():
    sign = replace(
        hand(1.0, user=1.0, bulge=0.04),
        message="the hand was given by the user, against evidence of confidence 0.998 for the "
        "other one",
    )
    (doubt,) = verdict(make_reconstruction(ANGLES, depth_sign=sign)).doubts
    assert "against evidence for the other one" in doubt.sentence
    assert doubt.size == 1.0


def test_what_was_taken_out_is_told_from_two_standard_deviations_on():
    def drag(c):
        return replace(trusted(), drag=DragFigures(coefficient_px=c, sigma_px=0.3,
                                                   formal_sigma_px=0.01))  # fmt: skip

    assert "the drag of the shading (0.9 ± 0.3 px)" in facts(judged(drag(0.9)))
    assert "drag of the shading (" not in facts(judged(drag(0.5)))


def test_perspective_that_was_taken_out_is_told_and_the_magnifications_are_then_not_judged():
    seen = PerspectiveFigures(
        kappa_per_px=1e-4, sigma_per_px=1e-6, distance_px=1e4, distance_radii=20.0,
        deviation_px=3.0, change_deg=1.2, used=True,
    )  # fmt: skip
    rec = with_scale(running(0.02))
    result = judged(replace(trusted(), perspective=seen), rec)
    assert result.doubts == ()
    assert "runs with the angle" not in facts(result)
    assert "perspective (which changed the rotation by 1.2°)" in facts(result)
    assert result.not_said(tuple(perspective_notes(seen, 0.1))) != ()
    unused = judged(replace(trusted(), perspective=replace(seen, used=False)), rec)
    assert len(unused.doubts) == 1


def test_notes_that_a_doubt_says_already_are_left_out_and_others_stay():
    rung = Rung(name="a", range_deg=9.0, bic=1.0, held_out_px=0.1, num_parameters=3)
    small = replace(trusted(total_deg=9.0, sigma_deg=0.4), models=(rung,))
    result = judged(small, make_reconstruction(np.linspace(0.0, 9.0, 10)))

    class Comparison:
        depth_uncertainty, disagree, message = 0.0, False, ""

    notes = reliability_notes(small, Comparison(), tilt_known=False)
    assert len(notes) == 1
    assert result.not_said((*notes, "vibration")) == ("vibration",)
    running_notes = magnification_notes(running(0.02), np.full((10, 2), 600.0), estimated=True)
    beyond = judged(trusted(), with_scale(running(0.02)))
    assert len(running_notes) == 1
    assert beyond.not_said(tuple(running_notes)) == ()


def test_every_doubt_of_a_bad_series_has_a_title_for_a_terminal_and_an_action():
    rec = make_reconstruction(np.arange(3) * 2.0, depth_sign=hand(0.6, "ambiguous", bulge=0.6))
    rec = replace(rec, world_unit="px", pixel_size_um=None)
    inputs = make_inputs(rec, names=[*rec.image_names, "lost.png"])
    bad = replace(trusted(total_deg=4.0, depth_uncertainty=0.3), drift_px={"a": (0.0, 0.9)})
    result = judge(compute_metrics(replace(inputs, reliability=bad)))
    assert len(result.doubts) >= 6
    for doubt in result.doubts:
        assert 0 < len(doubt.title) <= 62, doubt.title
        assert doubt.action
        assert not doubt.action.endswith(".")
    assert len(result.next) == len(set(result.next))
