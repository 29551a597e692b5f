import shutil
import sqlite3

import numpy as np
import pytest

from semsfm_colmap.config import read_config
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.report_evidence import read_evidence
from semsfm_colmap.records import MATCH_STEPS, ExtractRecord, MatchRecord


def evidence_of(path):
    project = Project(path)
    return read_evidence(project, RunRecord.read(project.record), read_config(project.config))


@pytest.fixture(scope="module")
def evidence(small_project):
    return evidence_of(small_project)


def test_the_evidence_holds_the_measured_keypoints_alone(small_project, evidence):
    record = RunRecord.read(Project(small_project).record).result("extract", ExtractRecord)
    assert {name: len(i.keypoints) for name, i in evidence.images.items()} == record.num_keypoints
    assert all(0 < i.in_track.sum() < len(i.in_track) for i in evidence.images.values())


def test_the_steps_of_the_matches_add_up_to_the_statistics_of_the_pairs(small_project, evidence):
    record = RunRecord.read(Project(small_project).record).result("match", MatchRecord)
    said = {frozenset((p.image_name_1, p.image_name_2)): p for p in record.pairs}
    assert len(evidence.pairs) == len([p for p in record.pairs if p.num_matches])
    for pair in evidence.pairs:
        statistics = said[frozenset(pair.names)]
        counts = np.bincount(pair.step, minlength=len(MATCH_STEPS))
        assert pair.steps_known
        assert counts.sum() == statistics.num_matches
        assert counts[0] == statistics.num_static_rejected
        assert counts[-1] == statistics.num_after_distance_filter


def test_without_the_table_of_steps_kept_and_dropped_are_told_apart(
    small_project, evidence, tmp_path
):
    copy = tmp_path / "p"
    shutil.copytree(small_project, copy)
    with sqlite3.connect(copy / "database.db") as db:
        db.execute("DROP TABLE semsfm_match_steps")
    db.close()
    for pair, other in zip(evidence_of(copy).pairs, evidence.pairs, strict=True):
        assert not pair.steps_known
        np.testing.assert_array_equal(pair.verified, other.verified)


def test_pixels_and_depth_maps_are_those_of_the_project(small_project, evidence):
    name = next(iter(evidence.images))
    pixels = evidence.read_pixels(name)
    depth_map = evidence.read_depth_map(name)
    assert pixels.dtype == np.uint8
    assert depth_map is None or np.isfinite(depth_map.depth).any()
    assert evidence.read_depth_map("no such image.tif") is None
