import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.report.json_text import to_json
from semsfm_colmap.report.metrics import compute_metrics
from semsfm_colmap.report.metrics_json import metrics_json
from tests.report.series import (
    cube,
    empty_reconstruction,
    full_inputs,
    guided_figures,
    make_inputs,
    make_reconstruction,
)

DOCS = Path(__file__).parents[2] / "docs" / "report.md"
ELSEWHERE = {("versions",), ("depth_sign", "evidence"), ("reliability",)}
"""Keys that are names of the data, or are explained in docs/files.md."""


def written_of(inputs):
    return metrics_json(compute_metrics(inputs))


def test_the_text_is_json_and_says_the_same():
    m = written_of(full_inputs())
    assert json.loads(to_json(m)) == m


def test_nested_parts_lie_flat():
    m = written_of(full_inputs())
    assert m["structure"]["median_point_sigma_world"] == pytest.approx(np.sqrt(0.03))
    assert "sigma" not in m["structure"]
    assert {"mean_x_px", "sigma_y_nm", "max_error_px"} < m["residuals"].keys()
    assert "x" not in m["residuals"]
    assert m["mesh"]["bounding_box_size_world"] == [1.0, 1.0, 1.0]
    assert m["filtering_rounds"][1] == {
        "threshold_px": 4.0,
        "num_observations": 90,
        "num_points": 7,
        "num_images": 3,
        "sigma_px": 0.4,
        "rms_px": 0.5,
        "num_kept": 90,
        "num_dropped": 10,
        "dropped_fraction": 0.1,
    }
    assert m["guided"] == asdict(guided_figures())
    assert m["telecentric"] == {"focal_length_px": 1e6, "max_deviation_px": 0.01}


def test_an_image_without_a_pose_has_its_matches_only():
    first, *_, lost = written_of(full_inputs())["per_image"]
    assert first["registered"] is True
    assert first["angle_deg"] == 0.0
    assert lost == {
        "frame": 7,
        "name": "lost.png",
        "registered": False,
        "num_matches": 0,
        "num_verified_matches": 0,
        "num_matches_to_next": None,
        "num_verified_matches_to_next": None,
    }


def test_reliability_says_what_is_known():
    m = written_of(full_inputs())["reliability"]
    assert m["drift_px"] == {"frame_000.png": [0.1, -0.2]}
    assert m["models"][0]["held_out_px"] is None
    assert "leave_one_out" not in m


def test_what_is_missing_is_empty_or_null():
    m = written_of(make_inputs(empty_reconstruction(1)))
    assert m["residuals"] == {"num_residuals": 0}
    assert m["rotation"] == {
        "axis_camera": None,
        "range_deg": 0.0,
        "closure": None,
        "stage_tilt": None,
    }
    assert m["reliability"] == {}
    assert m["telecentric"] == {}
    assert (m["guided"], m["mesh"], m["cloud"]) == (None, None, None)
    assert (m["filtering_rounds"], m["stages"]) == ([], [])


def test_a_mesh_without_a_face_has_its_counts_only():
    bare = replace(cube(), faces=np.zeros((0, 3), dtype=np.int64))
    m = written_of(make_inputs(make_reconstruction(np.arange(3) * 4.0), mesh=bare))
    assert m["mesh"] == {
        "num_vertices": 8,
        "num_faces": 0,
        "num_components": 0,
        "num_open_edges": 0,
        "area_world2": 0.0,
    }


def keys_of(value, parents=()):
    if isinstance(value, dict):
        for key, item in value.items():
            if parents not in ELSEWHERE:
                yield key
                yield from keys_of(item, (*parents, key))
    elif isinstance(value, list):
        for item in value:
            yield from keys_of(item, parents)


def test_every_key_is_explained_in_the_documentation():
    text = DOCS.read_text(encoding="utf-8")
    missing = {key for key in keys_of(written_of(full_inputs())) if f"`{key}`" not in text}
    assert not missing
