"""Collect values with their sources: what every vendor's reader returns."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from semsfm_colmap.io.wording import one_line
from semsfm_colmap.types import SemMetadata

MAX_SENTENCE = 400


@dataclass(frozen=True, kw_only=True)
class MetadataReading:
    """Metadata of one file, what the vendor says about the databar, and what is odd."""

    metadata: SemMetadata = field(default_factory=SemMetadata)
    vendor: str = ""
    image_rows: int | None = None
    """Rows of the image proper where the vendor states that a databar is below them."""
    databar_rows: int | None = None
    """Rows of the databar where the vendor gives them but not whether it is still there."""
    scale_bar_um: float | None = None
    """What is written at the burnt-in scale bar."""
    warnings: tuple[str, ...] = ()

    def with_warnings(self, warnings: tuple[str, ...]) -> MetadataReading:
        """The same reading with other warnings."""
        return replace(self, warnings=warnings)


class Collector:
    """Builds a `SemMetadata`: the first value of a field wins, each with its source."""

    def __init__(self, vendor: str) -> None:
        self.vendor = vendor
        self.values: dict[str, Any] = {}
        self.source: dict[str, str] = {}
        self.warnings: list[str] = []
        self.image_rows: int | None = None
        self.databar_rows: int | None = None
        self.scale_bar_um: float | None = None

    def put(self, field_name: str, value: Any, source: str) -> None:
        """Keep a value unless it is None or the field has one."""
        if isinstance(value, str):
            value = one_line(value) or None
        if value is not None and field_name not in self.values:
            self.values[field_name] = value
            self.source[field_name] = source

    def warn(self, sentence: str) -> None:
        """Note something the user should know about this file."""
        self.warnings.append(one_line(sentence, MAX_SENTENCE))

    def reading(self) -> MetadataReading:
        """What was collected."""
        return MetadataReading(
            metadata=SemMetadata(**self.values, source=dict(self.source)),
            vendor=self.vendor,
            image_rows=self.image_rows,
            databar_rows=self.databar_rows,
            scale_bar_um=self.scale_bar_um,
            warnings=tuple(self.warnings),
        )
