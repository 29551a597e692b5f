"""The guided second pass on a project: longer tracks, and the database to go with them."""

import json
import shutil

import numpy as np
import pytest

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import Config, config_from_dict
from semsfm_colmap.evaluation.compare import evaluate
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.mapping import guided
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.records import MapRecord
from tests.exports import consumers
from tests.pickled import pickled_map

PLAIN = config_from_dict({"guided": {"enabled": False}})


@pytest.fixture
def project(small_project, tmp_path):
    shutil.copytree(small_project, tmp_path / "p")
    return tmp_path / "p"


def stored(project):
    """Keypoints, descriptor counts and verified matches of the database."""
    with pycolmap.Database.open(str(project / "database.db")) as db:
        images = sorted(db.read_all_images(), key=lambda i: i.image_id)
        keypoints = {i.name: np.asarray(db.read_keypoints(i.image_id)) for i in images}
        described = {i.name: db.num_descriptors_for_image(i.image_id) for i in images}
        pair_ids, geometries = db.read_two_view_geometries()
        matches = {
            p: np.asarray(g.inlier_matches) for p, g in zip(pair_ids, geometries, strict=True)
        }
    return keypoints, described, matches


def test_tracks_are_longer_and_no_less_right_than_without(project, small_series):
    truth = load_truth(small_series)
    found = evaluate(read_model(project / "sparse" / "0"), truth)
    record = RunRecord.read(project / "run.json")
    figures = record.result("map", MapRecord).diagnostics.guided
    assert figures.num_observations > 1.3 * figures.num_observations_before
    assert figures.sigma_px < 0.8 * figures.sigma_before_px
    run_stages(project, PLAIN, names=("map",))
    plain = evaluate(read_model(project / "sparse" / "0"), truth)
    assert found["mean_track_length"] > 1.05 * plain["mean_track_length"]
    assert found["rotation_error_median_deg"] < 1.2 * plain["rotation_error_median_deg"]


def test_cameras_settle_on_a_sample_and_all_tracks_are_looked_for_in_the_end(
    project, small_series, monkeypatch
):
    truth = load_truth(small_series)
    # nothing is ever still enough: with a sample all passes but the first and the last look for it
    config = config_from_dict({"guided": {"converged_deg": 0.0, "rounds": 4, "fill_up_to": 0}})
    run_stages(project, config, names=("map",))
    alone = evaluate(read_model(project / "sparse" / "0"), truth)
    monkeypatch.setattr(guided, "SETTLING_OBSERVATIONS", 100)
    looked_for = []
    one_pass = guided.one_pass

    def counted(passes, value, seeds, **how):
        looked_for.append(len(seeds))
        return one_pass(passes, value, seeds, **how)

    monkeypatch.setattr(guided, "one_pass", counted)
    run_stages(project, config, names=("map",), force=True)
    assert len(looked_for) == 4
    assert max(looked_for[1:3]) < 0.5 * min(looked_for[0], looked_for[3])
    settled = evaluate(read_model(project / "sparse" / "0"), truth)
    assert settled["num_observations"] > 0.95 * alone["num_observations"]
    assert settled["rotation_error_median_deg"] < 1.2 * alone["rotation_error_median_deg"]


def assert_bundle_adjusters_leave_the_cameras(model, folder):
    """pycolmap's and, where it is installed, that of COLMAP's command line."""
    runs = [consumers.py_bundle_adjust]
    if consumers.has_colmap():
        runs.append(consumers.cli_bundle_adjust)
    before = consumers.own_figures(read_model(model))
    for k, run in enumerate(runs):
        after = run(model, folder / str(k))
        assert after.mean_error_px == pytest.approx(before.mean_error_px, abs=0.01)
        assert consumers.rotation_change_deg(model, folder / str(k)) < 0.02


def test_a_bundle_adjuster_of_colmap_leaves_the_cameras_where_they_are(project, tmp_path):
    """With the default options throughout: the guided pass, its adjustment, the focal length."""
    assert_bundle_adjusters_leave_the_cameras(project / "sparse" / "0", tmp_path)


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("name", ["sem_quartz3", "sem_pot1"])
def test_and_so_it_does_with_real_series(data_path, tmp_path, name):
    """Few images that turn little: what hardly holds the angles moves them most."""
    series = data_path / name
    images = series / "images" if (series / "images").is_dir() else series
    stages = ("ingest", "extract", "match", "map")
    run_stages(tmp_path / "p", Config(), names=stages, image_path=images)
    assert_bundle_adjusters_leave_the_cameras(tmp_path / "p" / "sparse" / "0", tmp_path)


def test_the_drift_taken_out_is_in_the_sidecar_and_none_is_without_a_prior(project):
    sidecar = project / "sparse" / "0" / "orthographic.json"
    drift = json.loads(sidecar.read_text())["reliability"]["drift_px"]
    assert sorted(drift) == sorted(read_model(project / "sparse" / "0").image_names)
    assert 0.0 < np.abs(list(drift.values())).max() < 1.0
    config = config_from_dict({"refinement": {"drift_sigma_px": 0.0}})
    run_stages(project, config, names=("map",))
    drift = json.loads(sidecar.read_text())["reliability"]["drift_px"]
    assert not np.any(list(drift.values()))


def test_measured_keypoints_keep_their_numbers_and_the_model_refers_to_appended_ones(project):
    keypoints, described, _ = stored(project)
    model = read_model(project / "sparse" / "0")
    obs = model.observations
    for i, name in enumerate(model.image_names):
        rows = obs.image_idx == i
        assert (obs.keypoint_idx[rows] >= described[name]).all()
        np.testing.assert_allclose(
            keypoints[name][obs.keypoint_idx[rows], :2], obs.xy[rows], atol=1e-4
        )
        assert len(np.unique(obs.keypoint_idx[rows])) == rows.sum()


def test_a_second_run_gives_the_same_model_and_database(project):
    before, model = stored(project), read_model(project / "sparse" / "0")
    run_stages(project, Config(), names=("map",), force=True)
    after, again = stored(project), read_model(project / "sparse" / "0")
    np.testing.assert_array_equal(model.cameras.cam_from_world, again.cameras.cam_from_world)
    for name in before[0]:
        np.testing.assert_array_equal(before[0][name], after[0][name])
    assert before[2].keys() == after[2].keys()
    for pair, rows in before[2].items():
        np.testing.assert_array_equal(rows, after[2][pair])


class OtherProcesses:
    """An executor whose functions and items go through pickle."""

    num_workers = 2
    shares_memory = False
    map = staticmethod(pickled_map)


def test_what_the_guided_pass_asks_of_other_processes_can_be_sent_to_them(project):
    model = read_model(project / "sparse" / "0")
    run_stages(project, Config(), names=("map",), force=True, executor=OtherProcesses())
    again = read_model(project / "sparse" / "0")
    np.testing.assert_array_equal(model.cameras.cam_from_world, again.cameras.cam_from_world)


def test_without_run_json_guided_keypoints_are_not_taken_for_measured_ones(project):
    before, model = stored(project), read_model(project / "sparse" / "0")
    (project / "run.json").unlink()
    run_stages(project, Config(), names=("map",))
    after, again = stored(project), read_model(project / "sparse" / "0")
    np.testing.assert_array_equal(model.cameras.cam_from_world, again.cameras.cam_from_world)
    for name in before[0]:
        np.testing.assert_array_equal(before[0][name], after[0][name])


def test_switched_off_the_database_is_as_matching_left_it(project):
    keypoints, described, matches = stored(project)
    run_stages(project, PLAIN, names=("map",))
    plain_keypoints, plain_described, plain_matches = stored(project)
    assert plain_described == described
    for name, count in described.items():
        assert len(plain_keypoints[name]) == count < len(keypoints[name])
    assert sum(map(len, plain_matches.values())) < sum(map(len, matches.values()))
    model = read_model(project / "sparse" / "0")
    assert model.observations.keypoint_idx.max() < max(described.values())


def test_images_that_cannot_be_aligned_leave_the_first_model(project):
    """Noise in place of the images: nothing is found again, and the first map stands."""
    import cv2

    plain = project.with_name("plain")
    shutil.copytree(project, plain)
    run_stages(plain, PLAIN, names=("map",))
    rng = np.random.default_rng(0)
    for path in (project / "images").iterdir():
        shape = cv2.imread(str(path), 0).shape
        cv2.imwrite(str(path), rng.integers(0, 255, shape, dtype=np.uint8))
    run_stages(project, Config(), names=("map",), force=True)
    first = read_model(plain / "sparse" / "0")
    kept = read_model(project / "sparse" / "0")
    np.testing.assert_array_equal(first.cameras.cam_from_world, kept.cameras.cam_from_world)
