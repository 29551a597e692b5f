from __future__ import annotations

from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from semsfm_colmap.ingest.series.refusals import check_options
from semsfm_colmap.ingest.series.tilt import parse_axis, tilt_prior
from semsfm_colmap.types import SemFrame, SemMetadata, SemSeries
from tests.ingest.images import save, texture


def series(tilts_deg: list[float | None], source: str = "FEI 34682 [Stage] StageT") -> SemSeries:
    frames = tuple(
        SemFrame(
            name=f"{i}.tif", width_px=10, height_px=10, source_path="", crop_px=(0, 0, 10, 10),
            metadata=SemMetadata(
                tilt_rad=None if tilt is None else radians(tilt),
                source={} if tilt is None else {"tilt_rad": source},
            ),
        )
        for i, tilt in enumerate(tilts_deg)
    )  # fmt: skip
    return SemSeries(frames=frames)


def test_a_stage_and_a_table_give_priors_with_their_own_sigma() -> None:
    stage = tilt_prior(series([0, 5, 10]), IngestOptions())
    table = tilt_prior(series([0, 5, 10], "table s.csv"), IngestOptions())
    assert stage is not None
    assert table is not None
    assert stage.sigma_rad == pytest.approx(radians(0.5))
    assert table.sigma_rad == pytest.approx(radians(0.2))
    assert table.source == "table s.csv"
    assert stage.range_rad == pytest.approx(radians(10))
    chosen = tilt_prior(series([0, 5, 10]), IngestOptions(tilt_sigma_deg=1.5))
    assert chosen is not None
    assert chosen.sigma_rad == pytest.approx(radians(1.5))


def moved(displacements_um: list[float | None], tilts_deg: list[float | None]) -> SemSeries:
    frames = tuple(
        replace(frame, metadata=replace(frame.metadata, displacement_um=um))
        for frame, um in zip(series(tilts_deg).frames, displacements_um, strict=True)
    )
    return SemSeries(frames=frames)


def test_a_calibrated_factor_makes_tilts_of_displacements_where_none_are_recorded() -> None:
    read = moved([0.0, None, 0.2], [None, None, None])
    prior = tilt_prior(read, IngestOptions(degrees_per_um=150.0))
    assert prior is not None
    np.testing.assert_allclose(np.rad2deg(prior.angle_rad), [0.0, np.nan, 30.0])
    assert prior.source == "displacements times degrees_per_um"
    # without a factor, or without displacements that differ, nothing is known of the angles
    assert tilt_prior(read, IngestOptions()) is None
    same = moved([0.2, None, 0.2], [None, None, None])
    assert tilt_prior(same, IngestOptions(degrees_per_um=150.0)) is None
    stage = tilt_prior(moved([0.0, 0.1, 0.2], [0, 5, 10]), IngestOptions(degrees_per_um=150.0))
    assert stage is not None
    assert stage.range_rad == pytest.approx(radians(10))


@pytest.mark.parametrize("factor", [0.0, float("nan"), float("inf")])
def test_factors_that_no_belt_has_are_refused(factor: float) -> None:
    with pytest.raises(UsageError, match="degrees_per_um"):
        check_options(IngestOptions(degrees_per_um=factor))


def test_a_tilt_that_does_not_vary_is_no_prior() -> None:
    assert tilt_prior(series([12.0, 12.0, 12.1]), IngestOptions()) is None
    assert tilt_prior(series([None, None, None]), IngestOptions()) is None
    assert tilt_prior(series([None, 3.0, None]), IngestOptions()) is None


def test_a_nominal_step_is_used_only_without_recorded_tilts() -> None:
    by_step = tilt_prior(series([None] * 4), IngestOptions(tilt_step_deg=-3.0, tilt_axis="y"))
    assert by_step is not None
    np.testing.assert_allclose(np.degrees(by_step.angle_rad), [0, -3, -6, -9])
    assert by_step.sigma_rad == pytest.approx(radians(0.3))
    assert by_step.axis_image_rad == pytest.approx(radians(90))
    recorded = tilt_prior(series([0, 5, 10]), IngestOptions(tilt_step_deg=3.0))
    assert recorded is not None
    assert np.degrees(recorded.angle_rad[-1]) == pytest.approx(10)


def test_images_without_a_tilt_stay_unknown() -> None:
    prior = tilt_prior(series([0, None, 10]), IngestOptions())
    assert prior is not None
    assert np.isnan(prior.angle_rad[1])
    assert prior.range_rad == pytest.approx(radians(10))


@pytest.mark.parametrize(
    ("text", "value"), [("auto", None), ("x", 0.0), ("Y", radians(90)), ("-30", radians(-30))]
)
def test_the_axis_is_read(text: str, value: float | None) -> None:
    assert parse_axis(text) == (pytest.approx(value) if value is not None else None)


@pytest.mark.parametrize("text", ["z", "nan", "north"])
def test_no_other_axis_is_accepted(text: str) -> None:
    with pytest.raises(UsageError, match="tilt_axis"):
        parse_axis(text)


def test_a_sigma_that_is_not_positive_is_a_usage_error() -> None:
    with pytest.raises(UsageError, match="tilt_sigma_deg"):
        tilt_prior(series([0, 5, 10]), IngestOptions(tilt_sigma_deg=0.0))


def test_the_prior_of_a_prepared_series_comes_from_its_table(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", texture(i))
    table = tmp_path / "s.csv"
    table.write_text("image,tilt_deg\n" + "".join(f"{i}.png,{7 * i}\n" for i in range(3)))
    options = IngestOptions(series_csv=table)
    prior = tilt_prior(prepare_series(folder, tmp_path / "p", options), options)
    assert prior is not None
    np.testing.assert_allclose(np.degrees(prior.angle_rad), [0, 7, 14])


def test_a_stage_that_tilts_and_rotates_gives_both_to_the_prior(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    for i in range(3):
        save(folder / f"{i}.png", texture(i))
    table = tmp_path / "series.csv"
    table.write_text("image,tilt_deg,rotation_deg\n0,20,0\n1,20,30\n2,20,60\n")
    options = IngestOptions(series_csv=table)
    prior = tilt_prior(prepare_series(folder, tmp_path / "p", options), options)
    assert prior is not None
    assert prior.rotation_rad is not None
    np.testing.assert_allclose(np.rad2deg(prior.rotation_rad), [0, 30, 60])
    table.write_text("image,tilt_deg,rotation_deg\n0,0,0\n1,10,0\n2,20,360\n")
    prior = tilt_prior(prepare_series(folder, tmp_path / "p", options), options)
    assert prior is not None
    assert prior.rotation_rad is None  # a whole turn is none
