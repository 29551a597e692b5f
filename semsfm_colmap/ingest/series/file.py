"""PROJECT/series.json: the prepared series on disk, read back exactly."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.io.atomic import write_text
from semsfm_colmap.io.names import check_names
from semsfm_colmap.io.versions import check_version
from semsfm_colmap.types import SemFrame, SemMetadata, SemSeries

FORMAT = "semsfm-series"
VERSION = 1


@dataclass(kw_only=True)
class PreparationRecord:
    """What was done to the images, kept in series.json beside the series itself."""

    options: dict[str, Any] = field(default_factory=dict)
    """The options that change pixels."""
    grey_range: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Per image the source's grey values that became 0 and 255."""
    mask_effect: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Per image the parts of area and of texture that its mask leaves out."""
    masks: list[str] = field(default_factory=list)
    """Mask files written."""

    @classmethod
    def of(cls, options: IngestOptions) -> PreparationRecord:
        """A record that starts with the options."""
        names = (
            "range_percentiles", "flat_field", "flat_field_scale", "denoise", "local_contrast",
            "masks",
        )  # fmt: skip
        return cls(options={name: getattr(options, name) for name in names})


@dataclass(frozen=True, kw_only=True)
class WrittenFiles:
    """Names of the images and masks that an earlier run wrote."""

    images: set[str]
    masks: set[str]


def write_series(series: SemSeries, path: Path, *, record: PreparationRecord | None = None) -> None:
    """Write a series and what was done to its images."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        **asdict(series),
        "preparation": asdict(record or PreparationRecord()),
    }
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    write_text(text + "\n", path)


def read_series(path: Path) -> SemSeries:
    """Read what `write_series` wrote."""
    content = _load(path)
    try:
        check_names((frame["name"] for frame in content["frames"]), path)
        return SemSeries(
            **{
                **_known(SemSeries, content),
                "frames": tuple(_frame(frame) for frame in content["frames"]),
                "warnings": tuple(content["warnings"]),
            }
        )
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path} is damaged ({type(error).__name__}: {error}); {_again(path)}"
        ) from error


def read_preparation(path: Path) -> PreparationRecord:
    """What was done to the images of a series."""
    return PreparationRecord(**_known(PreparationRecord, _load(path).get("preparation", {})))


def read_written_files(path: Path) -> WrittenFiles:
    """Files an earlier run wrote, which may be removed; empty where there was none."""
    try:
        content = _load(path)
        images = {str(frame["name"]) for frame in content["frames"]}
        masks = {str(name) for name in content.get("preparation", {}).get("masks", ())}
        check_names([*images, *masks], path)
        return WrittenFiles(images=images, masks=masks)
    except (InputError, KeyError, TypeError, AttributeError):
        return WrittenFiles(images=set(), masks=set())


def _again(path: Path) -> str:
    """What makes the file again."""
    project = shlex.quote(str(path.parent))
    return f"prepare the images again: `semsfm extract IMAGES --output_path {project}`."


def _load(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); {_again(path)}") from error
    except ValueError as error:
        raise InputError(f"{path} is not valid JSON ({error}); {_again(path)}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f"{path} is not a series file; {_again(path)}")
    check_version(content, VERSION, path, _again(path))
    return content


def _known(kind: type, content: Mapping[str, Any]) -> dict[str, Any]:
    names = {f.name for f in fields(kind)}
    return {key: value for key, value in content.items() if key in names}


def _frame(content: Mapping[str, Any]) -> SemFrame:
    metadata = _known(SemMetadata, content["metadata"])
    if metadata.get("stage_xyz_um") is not None:
        metadata["stage_xyz_um"] = tuple(metadata["stage_xyz_um"])
    return SemFrame(
        **{
            **_known(SemFrame, content),
            "crop_px": tuple(content["crop_px"]),
            "metadata": SemMetadata(**metadata),
            "warnings": tuple(content["warnings"]),
        }
    )
