import numpy as np
import pytest

from semsfm_colmap.config import Config
from semsfm_colmap.ingest.series.file import write_series
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.stages.match import files_of_order, predicted_rotation
from semsfm_colmap.types import SemFrame, SemMetadata, SemSeries


def series_of(displacements_um):
    frames = tuple(
        SemFrame(
            name=f"{k}.png",
            width_px=10,
            height_px=10,
            source_path="",
            crop_px=(0, 0, 10, 10),
            metadata=SemMetadata(displacement_um=um),
        )
        for k, um in enumerate(displacements_um)
    )
    return SemSeries(frames=frames)


def test_displacements_of_all_images_predict_their_order():
    angle = predicted_rotation(series_of([0.2, 0.0, 0.1]))
    np.testing.assert_array_equal(np.argsort(angle), [1, 2, 0])


@pytest.mark.parametrize(
    "displacements", [[None, None, None], [0.0, None, 0.1], [0.3, 0.3, 0.3]],
    ids=["none", "one is missing", "constant"],
)  # fmt: skip
def test_otherwise_the_names_do(displacements, tmp_path):
    series = series_of(displacements)
    assert predicted_rotation(series) is None
    write_series(series, tmp_path / "series.json")
    assert files_of_order(Project(tmp_path), Config()) == ()


def test_where_displacements_tell_the_order_the_matches_depend_on_the_series(tmp_path):
    project = Project(tmp_path)
    assert files_of_order(project, Config()) == ()
    write_series(series_of([0.0, 0.1, 0.2]), project.series)
    assert files_of_order(project, Config()) == (project.series,)
