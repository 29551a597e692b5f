"""The table says what was found and leaves out what was not computed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from semsfm_colmap.evaluation import evaluate, format_evaluation
from semsfm_colmap.types import DepthSign
from tests.evaluation.series import bumpy_ball, make_truth, mirrored, reconstruction_of

MESH = bumpy_ball()


def line_of(text: str, label: str) -> str:
    return next(line for line in text.splitlines() if label in line)


def test_the_figures_stand_in_the_table_with_their_units() -> None:
    truth = make_truth(mesh=MESH)
    r = reconstruction_of(truth, MESH.vertices[::20], pixel_noise_px=0.25)
    found = evaluate(r, truth)
    text = format_evaluation(found)
    assert line_of(text, "images").split() == ["images", "12", "of", "12"]
    assert "the right one" in line_of(text, "hand")
    residual = line_of(text, "residual per coordinate").split()
    assert float(residual[-2]) == pytest.approx(found["residual_rms_px"], abs=5e-4)
    assert residual[-1] == "px"
    assert "cameras" in text
    assert "points" in text


def test_what_was_not_computed_is_left_out() -> None:
    truth = make_truth()
    r = replace(reconstruction_of(truth, MESH.vertices[::20]), world_unit="px")
    text = format_evaluation(evaluate(r, truth))
    assert "mesh" not in text
    assert "scale error" not in text
    assert "off the surface" not in text
    assert "None" not in text


def test_a_wrong_hand_cannot_be_overlooked() -> None:
    truth = make_truth(mesh=MESH)
    r = mirrored(reconstruction_of(truth, MESH.vertices[::20]))
    r = replace(r, depth_sign=DepthSign(status="resolved", confidence=0.97))
    line = line_of(format_evaluation(evaluate(r, truth)), "hand")
    assert "DEPTH-REVERSED" in line
    assert "97% sure" in line


def test_columns_are_aligned() -> None:
    truth = make_truth(mesh=MESH)
    r = reconstruction_of(truth, MESH.vertices[::20])
    lines = format_evaluation(evaluate(r, truth)).splitlines()
    ends = {len(line) for line in lines if line.endswith(" px")}
    assert len(ends) == 1
