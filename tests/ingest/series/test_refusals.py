from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.images import save, texture, with_databar
from tests.ingest.prepared import prepare

OPTIONS = IngestOptions()


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"pixel_size_um": 0.0}, "pixel_size_um"),
        ({"pixel_size_um": float("nan")}, "pixel_size_um"),
        ({"scale_bar_um": -1.0}, "scale_bar_um"),
        ({"range_percentiles": (50.0, 50.0)}, "range_percentiles"),
        ({"max_image_pixels": 0}, "max_image_pixels"),
        ({"flat_field_scale": 0.0}, "flat_field_scale"),
        ({"local_contrast": -1.0}, "local_contrast"),
        ({"tilt_step_deg": 0.0}, "tilt_step_deg"),
        ({"tilt_sigma_deg": -0.1}, "tilt_sigma_deg"),
        ({"tilt_axis": "z"}, "tilt_axis"),
    ],
)
def test_options_that_no_series_can_have_are_usage_errors(
    good: Path, values: dict[str, object], sentence: str
) -> None:
    with pytest.raises(UsageError, match=sentence):
        prepare(good, replace(OPTIONS, **values))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("count", "sentence"),
    [(0, "no images in"), (1, "only 1 image "), (2, "only 2 images .* one-parameter family")],
)
def test_fewer_than_three_images_are_refused_in_one_sentence(
    folder: Path, tmp_path: Path, count: int, sentence: str
) -> None:
    for i in range(count):
        save(folder / f"{i}.png", texture(i))
    with pytest.raises(InputError, match=sentence):
        prepare_series(folder, tmp_path / "p", OPTIONS)


def test_the_originals_folder_as_output_is_refused(tmp_path: Path) -> None:
    for i in range(3):
        save(tmp_path / f"p/images/{i}.png", with_databar(texture(i)))
    with pytest.raises(UsageError, match="prepared images are written"):
        prepare_series(tmp_path / "p/images", tmp_path / "p", OPTIONS)
