"""Series that once gave a confident wrong answer, from their images to the models."""

import json
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.rotations import depth_reversed
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.records import MapRecord
from tests.alignment import rotation_errors_deg

pytestmark = [pytest.mark.data, pytest.mark.slow]

PLANE = Config(ingest=IngestOptions(detect_databar=False))


def mapped(images: Path, project: Path, config: Config | None = None) -> MapRecord:
    names = ("ingest", "extract", "match", "map")
    record = run_stages(project, config or Config(), names=names, image_path=images)
    return record.result("map", MapRecord)


@pytest.mark.parametrize("folder", ["images_rot0", "images_rot2"])
def test_a_plane_is_refused_with_its_family_of_solutions(cases_path, tmp_path, folder):
    with pytest.raises(InputError, match="known up to one parameter") as said:
        mapped(cases_path / "planar_0_48" / folder, tmp_path / "p", PLANE)
    assert "turned by 48.0 deg" in str(said.value)


def test_a_model_of_noise_is_refused(cases_path, tmp_path):
    with pytest.raises(InputError, match="no model that can be trusted"):
        mapped(cases_path / "stem_needle_haadf" / "images", tmp_path / "p")


def test_other_magnifications_are_no_drift(cases_path, tmp_path):
    case = cases_path / "false_scan_drift"
    result = mapped(case / "images", tmp_path / "p")
    assert not any("drifted" in note for note in result.notes)
    assert any("magnification differs" in note for note in result.notes)
    assert np.max(np.abs(list(result.reliability.drift_px.values()))) == 0.0
    truth = {
        image["name"]: image for image in json.loads((case / "truth.json").read_text())["images"]
    }
    model = Project(tmp_path / "p").read_main_model()
    true = [truth[name] for name in model.image_names]
    R, R_true = np.asarray(model.cameras.cam_from_world), np.array([t["R"] for t in true])
    errors = min(
        (rotation_errors_deg(hand, R_true) for hand in (R, depth_reversed(R))), key=np.median
    )
    assert np.median(errors) < 0.06
    ratio = model.cameras.scale_px_per_unit / np.array([t["s"] for t in true])
    assert np.std(np.log(ratio)) < 3e-4


def test_frames_that_shrink_are_said_and_are_in_the_error_bars(cases_path, tmp_path):
    result = mapped(cases_path / "anisotropic_shrink" / "images", tmp_path / "p")
    trust = result.reliability
    assert any("differ in size" in note for note in result.notes)
    assert abs(trust.total_rotation_deg - 35.9) < 2.0 * trust.total_rotation_sigma_deg
    assert trust.total_rotation_sigma_parts_deg["models"] > 0.1
