import numpy as np
import pytest

from semsfm_colmap.colmap.model.sidecar import read_sidecar
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import read_config
from semsfm_colmap.geometry.rotations import vector_from_rotation
from semsfm_colmap.mapping.pose_covariance import angle_stretch, rotation_covariance
from semsfm_colmap.records import Reliability, from_plain
from semsfm_colmap.refinement.model_choice import widest_pair


@pytest.fixture(scope="module")
def mapped(small_project):
    folder = small_project / "sparse" / "0"
    reliability = from_plain(Reliability, read_sidecar(folder / "orthographic.json")["reliability"])
    return read_model(folder), reliability, read_config(small_project / "semsfm.toml").refinement


def test_the_total_rotation_has_the_standard_deviation_that_mapping_wrote(mapped):
    model, reliability, options = mapped
    covariance = rotation_covariance(model, options, reliability)
    R = np.asarray(model.cameras.cam_from_world)
    a, b = widest_pair(R)
    n = vector_from_rotation(R[b] @ R[a].T)
    g = np.zeros((len(R), 3))
    g[b] += n / np.linalg.norm(n)
    g[a] -= n / np.linalg.norm(n)
    again = np.rad2deg(np.sqrt(g.reshape(-1) @ covariance @ g.reshape(-1)))
    parts = dict(reliability.total_rotation_sigma_parts_deg)
    told = np.linalg.norm([parts[name] for name in parts if name != "models"])
    # the drag's doubt follows the total rotation, which the last adjustment has moved a little
    assert again == pytest.approx(told, rel=0.01)


def test_it_is_a_covariance_and_none_of_it_turns_the_world(mapped):
    model, reliability, options = mapped
    covariance = rotation_covariance(model, options, reliability)
    assert covariance.shape == (3 * model.num_images, 3 * model.num_images)
    np.testing.assert_allclose(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance)[0] > -1e-9 * np.trace(covariance)


def test_the_stretch_is_what_only_the_record_knows(mapped):
    _, reliability, _ = mapped
    models = reliability.total_rotation_sigma_parts_deg.get("models", 0.0)
    assert angle_stretch(reliability) == pytest.approx(models / reliability.total_rotation_deg)
    assert angle_stretch(None) == 0.0
