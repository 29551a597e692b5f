import csv

import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.studies.features.options import UNION, CompareOptions, StudyOptions
from semsfm_colmap.studies.features.run import compare_features
from semsfm_colmap.synthetic import SynthesizeOptions, synthesize

STUDY = StudyOptions(
    detectors=("harris-hessian-laplace", "edge-laplace", "colmap-sift", UNION),
    descriptors=("sift", "gloh"),
    max_num_pairs=1,
)
OPTIONS = CompareOptions(study=STUDY, detection=DetectorOptions(max_num_features=600))


@pytest.fixture(scope="module")
def series(tmp_path_factory):
    folder = tmp_path_factory.mktemp("field")
    synthesize(
        folder,
        SynthesizeOptions(
            scene="field", num_images=3, step_deg=6.0, width_px=320, height_px=240, databar=False
        ),
    )
    return folder


def read(path):
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def run(series, output, **more):
    return compare_features(
        series / "images",
        output,
        options=more.pop("options", OPTIONS),
        ingest=IngestOptions(),
        **more,
    )


def test_the_study_writes_figures_and_tables_and_its_numbers_make_sense(series, tmp_path):
    result = run(series, tmp_path, truth_path=series)
    names = {p.name for p in tmp_path.iterdir()}
    expected = {"figure03.png", "figure12.png", "figure13.png", "table1.png", "truth.png"}
    expected |= {"figure12.csv", "figure13.csv", "table1.csv", "speed.csv", "pairs.csv"}
    assert names == expected | {"repeatability.csv"}
    rows = {(r["detector"], r["descriptor"]): r for r in read(tmp_path / "figure12.csv")}
    assert len(rows) == 8
    for row in rows.values():
        matched, filtered, robust = (
            float(row[k]) for k in ("matched", "heuristically_filtered", "robustly_filtered")
        )
        assert matched >= filtered > 0
        assert matched >= robust
    best = rows["harris-hessian-laplace", "sift"]
    assert float(best["precision_robust"]) > 0.9
    assert float(best["robustly_filtered"]) > 50
    # SIFT on both pairs, the other descriptor on the first only
    assert len(result.select("edge-laplace", "sift")) == 2
    assert len(result.select("edge-laplace", "gloh")) == 1
    # and averages over what both have
    first = result.select("edge-laplace", "sift")[0]
    assert float(rows["edge-laplace", "sift"]["matched"]) == first.matched
    for row in read(tmp_path / "table1.csv"):
        assert float(row[row["percent"]]) == 100.0
    shares = [r.share for r in result.repeatability["harris-hessian-laplace"]]
    assert all(0.2 < share <= 1.0 for share in shares)
    angles = [r.angle_deg for r in result.repeatability["harris-hessian-laplace"]]
    assert angles == pytest.approx([6.0, 12.0], abs=1.0)


def test_without_truth_there_are_no_figures_about_it(series, tmp_path):
    study = StudyOptions(detectors=("hessian-laplace",), descriptors=("sift",), max_num_images=2)
    result = run(series, tmp_path, options=CompareOptions(study=study))
    assert not result.has_truth
    assert not (tmp_path / "truth.png").exists()
    assert "precision_robust" not in read(tmp_path / "figure12.csv")[0]


def test_unknown_names_are_refused_before_anything_is_computed(series, tmp_path):
    with pytest.raises(UsageError, match="no detector 'surf'"):
        run(series, tmp_path, options=CompareOptions(study=StudyOptions(detectors=("surf",))))
    with pytest.raises(UsageError, match="no descriptor 'orb'"):
        run(series, tmp_path, options=CompareOptions(study=StudyOptions(descriptors=("orb",))))


def test_one_image_is_too_few(series, tmp_path):
    with pytest.raises(InputError, match="two are needed"):
        run(series, tmp_path, options=CompareOptions(study=StudyOptions(step=5)))
