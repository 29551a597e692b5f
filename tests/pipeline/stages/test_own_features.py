"""Our detectors and descriptors in a project, in place of COLMAP's SIFT."""

import numpy as np
import pytest

from semsfm_colmap.colmap.database.work import (
    read_descriptors,
    read_images,
    read_keypoint_rows,
    read_matches,
)
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import config_from_dict
from semsfm_colmap.errors import UsageError
from semsfm_colmap.evaluation.compare import evaluate
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.runner import run_stages

STAGES = ("ingest", "extract", "match", "map")


def config(detector, descriptor):
    return config_from_dict(
        {
            "features": {"detector": detector, "descriptor": descriptor, "upright": True},
            "matching": {"max_ratio": 0.85},
        }
    )


@pytest.mark.parametrize(
    ("detector", "descriptor", "stored"),
    [
        ("harris-hessian-laplace", "rootsift", True),
        ("hessian-affine", "gloh", False),
        pytest.param("harris-laplace+colmap-sift-affine", "rootsift", True, marks=pytest.mark.slow),
    ],
)
def test_any_detector_with_any_descriptor_gives_a_right_model(
    small_series, tmp_path, detector, descriptor, stored
):
    run_stages(
        tmp_path / "p",
        config(detector, descriptor),
        names=STAGES,
        image_path=small_series / "images",
    )
    database = Project(tmp_path / "p").database
    for image in read_images(database):
        rows = read_keypoint_rows(database, image.image_id)
        assert rows.shape[1] == 6
        if stored:
            descriptors = read_descriptors(database, image.image_id)
            assert descriptors.dtype == np.uint8
            assert descriptors.shape[1] == 128
            assert len(descriptors) <= len(rows)
        else:
            with pycolmap.Database.open(str(database)) as db:
                assert not db.exists_descriptors(image.image_id)
    assert sum(map(len, read_matches(database).values())) > 1000
    figures = evaluate(read_model(tmp_path / "p" / "sparse" / "0"), load_truth(small_series))
    assert figures["num_images_registered"] == 7
    assert figures["rotation_error_median_deg"] < 0.8


def test_an_unknown_detector_or_descriptor_is_refused_in_one_sentence(small_series, tmp_path):
    for detector, descriptor in (("harris-laplac", "rootsift"), ("hessian-laplace", "sifft")):
        with pytest.raises(UsageError, match="there is no"):
            run_stages(
                tmp_path / "p",
                config(detector, descriptor),
                names=("ingest", "extract"),
                image_path=small_series / "images",
            )
