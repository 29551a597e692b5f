"""The end of a command fits a terminal and says what the report says."""

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.metrics import compute_metrics
from semsfm_colmap.report.metrics_json import metrics_json
from semsfm_colmap.report.summary import WIDTH, summary_lines
from semsfm_colmap.types import DepthSign
from tests.report.series import cube, empty_reconstruction, make_inputs, make_reconstruction
from tests.report.test_verdict import ANGLES, trusted

FILES = ("report/report.html", "mesh/mesh.ply", "mesh/mesh.glb", "dense/fused.ply", "sparse/0")
NEXT = ("open project/report/report.html in a browser", "semsfm measure project")


def lines_of(inputs, **more):
    return summary_lines(metrics_json(compute_metrics(inputs)), FILES, NEXT, **more)


def bad_inputs():
    rec = make_reconstruction(np.arange(3) * 2.0)
    sign = DepthSign(status="ambiguous", confidence=0.62, evidence={"bulge": 0.62})
    rec = replace(rec, world_unit="px", pixel_size_um=None, depth_sign=sign)
    bad = replace(trusted(total_deg=4.0, depth_uncertainty=0.3), drift_px={"a": (0.0, 0.9)})
    names = [*rec.image_names, "lost.png"]
    return make_inputs(rec, names=names, reliability=bad, mesh=cube())


@pytest.mark.parametrize("make", [bad_inputs, lambda: make_inputs(empty_reconstruction(2))])
def test_it_fits_a_screen_in_plain_ascii_however_bad_the_series(make):
    lines = lines_of(make(), failed=("mesh, see above",))
    assert len(lines) + 2 < 24
    for line in lines:
        assert line.isascii()
        assert len(line) <= WIDTH
    assert any(line.split() == ["failed", "mesh,", "see", "above"] for line in lines)


def test_a_sound_series_in_a_few_lines():
    inputs = make_inputs(make_reconstruction(ANGLES), reliability=trusted(), mesh=cube())
    text = "\n".join(lines_of(inputs))
    for part in (
        "images   10 of 10, 400 points, residual 0.41 px = 20 nm",
        "rotation 36.00 +- 0.10 deg",
        "hand     decided, 99 %",
        "scale    one pixel is 50.00 nm (test chart)",
        "mesh     1.00 x 1.00 x 1.00 um, 12 faces",
        "doubts   none",
        "files    report/report.html",
        "next     open project",
    ):
        assert part in text, text


def test_the_doubts_come_with_what_settles_them_and_the_rest_is_counted():
    lines = lines_of(bad_inputs())
    text = "\n".join(lines)
    assert "hand     open; the first model has 62 %" in text
    assert "scale    no pixel size: all lengths are in px" in text
    assert sum(line.strip().startswith("-> ") for line in lines) == 3
    assert "the hand is open: the model may be inside out" in text
    assert "more: see the report" in text
    assert " um" not in text


def test_a_rotation_without_an_error_bar_says_so():
    none = replace(trusted(), total_rotation_sigma_parts_deg=None)
    text = "\n".join(lines_of(make_inputs(make_reconstruction(ANGLES), reliability=none)))
    assert "36.00 deg, no error bar" in text


def test_a_full_turn_is_not_said_to_be_half_of_one():
    half = replace(trusted(), total_rotation_deg=179.2)
    inputs = make_inputs(make_reconstruction(np.arange(24) * 15.0), reliability=half)
    text = "\n".join(lines_of(inputs))
    assert "rotation 345 deg about one axis; between two views at most 179.20 +- 0.10 deg" in text
