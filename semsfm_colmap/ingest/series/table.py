"""The table a person writes beside the images: what the microscope did not record.

A CSV file with a column ``image`` and any of ``tilt_deg``, ``rotation_deg``, ``displacement_um``,
``pixel_size_um``; cells may be empty. Comma, semicolon or tab separate; with semicolons a decimal
comma is understood.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.ingest.files.angles_in_names import angles_in_names
from semsfm_colmap.ingest.metadata.text import LENGTH_UM
from semsfm_colmap.io.csv_cells import plain_cell
from semsfm_colmap.io.wording import abbreviate, one_line

COLUMNS = ("tilt_deg", "rotation_deg", "displacement_um", "pixel_size_um")
ALIASES = {
    **dict.fromkeys(("image", "image name", "file", "filename", "file name"), "image"),
    **dict.fromkeys(
        ("tilt", "tilt angle", "stage tilt", "alpha", "angle", "stage t"), "tilt_deg"
    ),
    **dict.fromkeys(("rotation", "rot", "stage rotation", "stage r"), "rotation_deg"),
    "displacement": "displacement_um",
    **dict.fromkeys(("pixel size", "pixelsize", "pixel width"), "pixel_size_um"),
}  # fmt: skip
"""Titles of columns in words, as spreadsheets have them."""
ANGLE_UNITS = {
    **dict.fromkeys(("deg", "degree", "degrees", "\u00b0"), 1.0),
    **dict.fromkeys(("rad", "radian", "radians"), math.degrees(1.0)),
    "mrad": math.degrees(1e-3),
}  # fmt: skip
_TITLE = re.compile(
    r"(?P<base>.*?)(?:[\s_/(\[,]*(?P<unit>deg|degrees?|\u00b0|m?rad|radians?|um|\u00b5m|\u03bcm|nm|mm)"
    r"(?:/px|/pixel)?[)\]]?)?"
)
MAX_TABLE_BYTES = 16 << 20


@dataclass(frozen=True, kw_only=True)
class SeriesRow:
    """What the table says about one image; None where the cell is empty."""

    image: str
    tilt_deg: float | None = None
    rotation_deg: float | None = None
    displacement_um: float | None = None
    pixel_size_um: float | None = None


@dataclass(frozen=True, kw_only=True)
class SeriesTable:
    """The rows of a table, in its order."""

    path: Path
    rows: tuple[SeriesRow, ...]
    warnings: tuple[str, ...] = ()
    of_names: bool = False
    """True where the values are read from the names of the files."""

    @property
    def title(self) -> str:
        """What its values are called in messages."""
        return "the names of the files" if self.of_names else self.path.name

    @property
    def source(self) -> str:
        """Where its values come from, in metadata."""
        return "names of the files" if self.of_names else f"table {self.path.name}"

    def match(self, names: Sequence[str]) -> dict[str, SeriesRow]:
        """The row of each image: by full name, else by file name, else by name without suffix."""
        by_name: dict[str, list[str]] = {}
        for name in names:
            path = PurePosixPath(name)
            for key in {name, path.name, _without_suffix(path), path.stem}:
                by_name.setdefault(key, []).append(name)
        found: dict[str, SeriesRow] = {}
        for row in self.rows:
            path = PurePosixPath(row.image)
            candidates = [row.image, path.name, _without_suffix(path), path.stem]
            for key in candidates:
                images = by_name.get(key, [])
                if row.image in images:
                    images = [row.image]
                if len(images) == 1:
                    found.setdefault(images[0], row)
                    break
        return found


def _without_suffix(path: PurePosixPath) -> str:
    return str(path.parent / path.stem)


def read_series_table(path: Path) -> SeriesTable:
    """Read a table; what is wrong with it is said with the line number."""
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_TABLE_BYTES + 1)
    except OSError as error:
        raise UsageError(
            f"{path} cannot be read ({error.strerror}); give the table of the series."
        ) from error
    if len(raw) > MAX_TABLE_BYTES:
        raise UsageError(f"{path} is larger than {MAX_TABLE_BYTES >> 20} MiB: it is no table.")
    try:
        text = raw.decode(_encoding(raw))
    except UnicodeDecodeError as error:
        raise UsageError(f"{path} is not UTF-8 text; save the table as CSV in UTF-8.") from error
    if "\x00" in text:
        raise UsageError(f"{path} is not a text file; save the table as CSV in UTF-8.")
    # Comments and empty lines are blanked, not dropped, so that the reader counts them.
    lines = ["\n" if line.startswith("#") else line for line in io.StringIO(text)]
    first = next((line for line in lines if line.strip()), None)
    delimiter = max(";\t,", key=(first or "").count)
    try:
        reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
        numbered = [(reader.line_num, line) for line in reader if any(c.strip() for c in line)]
    except csv.Error as error:
        raise UsageError(f"{path} is not a CSV table ({error}).") from error
    if not numbered:
        raise UsageError(f"{path} is empty; it needs a first line that names its columns.")
    header, factors = _columns(numbered[0][1])
    if "image" not in header:
        raise UsageError(
            f"{path} has the columns {abbreviate(header, 6)} but needs one named image, and any of "
            f"{', '.join(COLUMNS)}."
        )
    unknown = [name for name in header if name and name not in (*COLUMNS, "image")]
    warnings = []
    if unknown:
        warnings.append(
            f"{path.name}: column {abbreviate(unknown, 6)} is not known and not used; known are "
            f"{', '.join(COLUMNS)}."
        )
    rows = [
        _row(
            path,
            number,
            dict(zip(header, map(plain_cell, line), strict=False)),
            factors,
            decimal_comma=delimiter == ";",
        )
        for number, line in numbered[1:]
    ]
    names = Counter(row.image for row in rows)
    twice, count = names.most_common(1)[0] if rows else ("", 1)
    if count > 1:
        raise UsageError(f"{path} has two lines for {one_line(twice)}; keep one.")
    return SeriesTable(path=path, rows=tuple(rows), warnings=tuple(warnings))


def match_table(table: SeriesTable, names: Sequence[str]) -> tuple[dict[str, SeriesRow], list[str]]:
    """The rows by image name, and sentences about lines and images without partner."""
    found = table.match(names)
    if not found:
        first = one_line(table.rows[0].image) if table.rows else "nothing"
        raise InputError(
            f"none of the images named in {table.path} is in the image folder; the first line "
            f"names {first}, the first image is {names[0]}."
        )
    used = {row.image for row in found.values()}
    warnings = list(table.warnings)
    extra = [row.image for row in table.rows if row.image not in used]
    missing = [name for name in names if name not in found]
    for kind, those in (("has lines for images that are not there", extra),
                        ("has no line for", missing)):  # fmt: skip
        if those:
            warnings.append(f"{table.path.name} {kind}: {abbreviate(those)}.")
    return found, warnings


def table_of_names(names: Sequence[str]) -> SeriesTable:
    """The tilts in the names of the files, as a table."""
    angles = angles_in_names(names)
    if angles is None:
        without = next(name for name in names if angles_in_names([name]) is None)
        raise InputError(
            f"tilt_from_names is asked for, but {without} does not end in an angle in degrees, "
            "such as tilt_-10.tif; rename it, or give the tilts in a table."
        )
    rows = [
        SeriesRow(image=name, tilt_deg=angle) for name, angle in zip(names, angles, strict=True)
    ]
    return SeriesTable(path=Path(), rows=tuple(rows), of_names=True)


def _encoding(raw: bytes) -> str:
    """UTF-16 as spreadsheets save it, with a mark or told by its zeros; else UTF-8."""
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    start = raw[:200]
    if len(start) >= 4 and not any(start[::2]) and all(start[1::2]):
        return "utf-16-be"
    if len(start) >= 4 and not any(start[1::2]) and all(start[::2]):
        return "utf-16-le"
    return "utf-8-sig"


def _columns(titles: Sequence[str]) -> tuple[list[str], dict[str, float]]:
    """Names of the columns as they are known here, and what to multiply their numbers with.

    ``Tilt (deg)``, ``Pixel size [nm]``, ``Filename`` are understood; a title without a unit, or in
    another one, is left as it is, so that it is said not to be known.
    """
    header: list[str] = []
    factors: dict[str, float] = {}
    for title in titles:
        name = title.strip().lower()
        found = _TITLE.fullmatch(name)
        base = re.sub(r"[\s_-]+", " ", found["base"] if found else name).strip()
        unit = (found["unit"] or "").strip() if found else ""
        column, factor = ALIASES.get(base), 1.0
        if column in ("tilt_deg", "rotation_deg"):
            factor = ANGLE_UNITS.get(unit, 0.0)
        elif column in ("displacement_um", "pixel_size_um"):
            factor = LENGTH_UM.get(unit, 0.0)
        spelt_so = name in COLUMNS or name.endswith((")", "]")) or column == "image"
        if column is None or factor == 0.0 or column in header or not spelt_so:
            column, factor = name, 1.0
        header.append(column)
        factors[column] = factor
    return header, factors


def _row(
    path: Path, line: int, cells: dict[str, str], factors: dict[str, float], *, decimal_comma: bool
) -> SeriesRow:
    name = cells.get("image", "").strip().replace("\\", "/").removeprefix("./")
    if not name:
        raise UsageError(f"{path}, line {line}: the column image is empty.")
    values: dict[str, float] = {}
    for column in COLUMNS:
        text = (cells.get(column) or "").strip()
        if not text:
            continue
        said = repr(text[:40])
        try:
            value = float(text.replace(",", ".") if decimal_comma else text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise UsageError(f"{path}, line {line}: {column} is {said}, not a number.")
        if column == "pixel_size_um" and value <= 0:
            raise UsageError(f"{path}, line {line}: {column} is {said} but must be positive.")
        if column.endswith("_deg") and abs(value) > 720:
            raise UsageError(f"{path}, line {line}: {column} is {said}, no angle in degrees.")
        values[column] = value * factors.get(column, 1.0)
    return SeriesRow(image=name, **values)
