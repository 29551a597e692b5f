from semsfm_colmap.pipeline.feature_study import read_feature_study
from semsfm_colmap.pipeline.project import Project


def test_the_study_of_a_project_is_read_and_its_absence_too(tmp_path):
    project = Project(tmp_path)
    assert read_feature_study(project) is None
    project.feature_study.mkdir()
    (project.feature_study / "table1.csv").write_text("percent,a,b\na,100.0,3.0\nb,4.0,100.0\n")
    (project.feature_study / "figure12.png").write_bytes(b"png")
    study = read_feature_study(project)
    assert study is not None
    assert study.overlap[1] == ("a", "100.0", "3.0")
    assert dict(study.figures) == {"figure12": b"png"}
