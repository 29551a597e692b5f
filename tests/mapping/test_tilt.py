"""Known tilts end to end: a table that is right, none, and one that is wrong, on one matching."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from semsfm_colmap.config import Config, FeatureOptions
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.pipeline.evaluate import evaluate_project
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.records import MapRecord, TiltAgreement
from tests.conftest import DATA

NICKEL = DATA / "synth_nickel"
CONFIG = Config(features=FeatureOptions(max_num_features=2500))
pytestmark = [
    pytest.mark.data,
    pytest.mark.slow,
    pytest.mark.skipif(not NICKEL.is_dir(), reason="needs the development data"),
]


@dataclass(frozen=True)
class Mapped:
    """A map, what it says, and how far it is from the truth."""

    notes: str
    prior: TiltAgreement | None
    figures: dict[str, Any]


@pytest.fixture(scope="module")
def matched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with features and matches, to be copied."""
    project = tmp_path_factory.mktemp("tilt") / "matched"
    stages = ("ingest", "extract", "match")
    run_stages(project, CONFIG, names=stages, image_path=NICKEL / "images")
    return project


def map_with(matched: Path, name: str, factor: float | None, names: list[str]) -> Mapped:
    """Map a copy of the project, with the databar's angles times a factor, or none."""
    project = matched.parent / name
    shutil.copytree(matched, project)
    options = IngestOptions()
    if factor is not None:
        truth = json.loads((NICKEL / "truth.json").read_text())
        lines = [f"{f['name']},{factor * f['nominal_deg']:g}\n" for f in truth["frames"]]
        table = matched.parent / f"{name}.csv"
        table.write_text("image,tilt_deg\n" + "".join(lines))
        options = IngestOptions(series_csv=table, tilt_sigma_deg=0.2)
    images = matched.parent / f"{name}_images"
    images.mkdir()
    for image in names:
        (images / image).symlink_to((NICKEL / "images" / image).resolve())
    if options.series_csv and len(names) < 13:
        kept = options.series_csv.read_text().splitlines()
        kept = [line for line in kept if line.split(",")[0] in ("image", *names)]
        options.series_csv.write_text("\n".join(kept) + "\n")
    config = replace(CONFIG, ingest=options)
    run_stages(project, config, names=("ingest",), image_path=images)
    record = run_stages(project, config, names=("map",))
    summary = record.result("map", MapRecord)
    figures, _ = evaluate_project(project, NICKEL)
    return Mapped(
        notes=" ".join(summary.notes),
        prior=summary.diagnostics.tilt,
        figures=figures,
    )


ALL = [f"nickel_{i:03}.png" for i in range(13)]
THREE = ALL[5:8]


@pytest.fixture(scope="module")
def maps(matched: Path) -> dict[str, Mapped]:
    """None, right, and a fifth too large."""
    factors = {"none": None, "right": 1.0, "wrong": 1.2}
    return {name: map_with(matched, name, factor, ALL) for name, factor in factors.items()}


def test_a_right_table_and_none_are_both_right(maps: dict[str, Mapped]) -> None:
    for name in ("none", "right"):
        figures = maps[name].figures
        assert figures["num_images_registered"] == 13
        assert figures["rotation_sum_ratio"] == pytest.approx(1.0, abs=2e-3)
        assert figures["rotation_error_max_deg"] < 0.2


def test_a_right_table_makes_nothing_worse(maps: dict[str, Mapped]) -> None:
    for figure in ("rotation_error_rms_deg", "rotation_error_max_deg"):
        assert maps["right"].figures[figure] < maps["none"].figures[figure] + 0.01
    structure = "structure_abs_median_px"
    assert maps["right"].figures[structure] < 1.01 * maps["none"].figures[structure]


def test_a_right_table_counts_and_says_so(maps: dict[str, Mapped]) -> None:
    prior = maps["right"].prior
    assert prior is not None
    assert prior.consistent
    assert 0.05 < prior.weight < 0.2
    assert "the estimated tilt is " in maps["right"].notes
    assert maps["none"].prior is None


def test_a_table_that_is_wrong_by_a_fifth_is_said_and_not_obeyed(maps: dict[str, Mapped]) -> None:
    wrong = maps["wrong"]
    assert wrong.prior is not None
    assert not wrong.prior.consistent
    assert wrong.prior.factor == pytest.approx(1 / 1.2, rel=0.01)
    assert "span 72.0 degrees, but the images show 60" in wrong.notes
    assert "they are not obeyed" in wrong.notes
    errors = [
        list(maps[name].figures["rotation_error_by_image_deg"].values())
        for name in ("none", "wrong")
    ]
    np.testing.assert_allclose(errors[0], errors[1], atol=1e-6)


def test_over_ten_degrees_a_right_table_corrects_the_images(matched: Path) -> None:
    """Three views over 10 degrees, where the images alone are wrong by percents."""
    alone = map_with(matched, "three_alone", None, THREE)
    helped = map_with(matched, "three_right", 1.0, THREE)
    before = abs(alone.figures["rotation_sum_ratio"] - 1)
    after = abs(helped.figures["rotation_sum_ratio"] - 1)
    assert before > 0.01  # else there is nothing to correct
    assert after < 0.6 * before
    assert after < 0.02
    assert helped.prior is not None
    assert helped.prior.weight > 0.5
