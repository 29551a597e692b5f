"""Every file of a project damaged in several ways: made again to the bit, and said."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks.reliability.projects import LOCK, Series, differences, files, fresh
from semsfm_colmap.errors import SemSfmError
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.pipeline.runner import reconstruct

WAYS = ("emptied", "cut", "deleted", "one bit")
NOT_RESULTS = {LOCK, "semsfm.log"}


class Ear(Reporter):
    """Keeps the warnings."""

    def __init__(self) -> None:
        super().__init__(-1)
        self.heard: list[str] = []

    def warn(self, line: str) -> None:
        """Keep it."""
        self.heard.append(line)


def outputs(series: Series) -> list[str]:
    """Every file that a run leaves."""
    return sorted(files(series.reference) - NOT_RESULTS)


def damaged(content: bytes, way: str) -> bytes:
    """Another content."""
    middle = len(content) // 2
    if way == "emptied":
        return b""
    if way == "cut":
        return content[:middle]
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


def damage(series: Series, folder: Path, name: str, way: str) -> dict[str, object]:
    """Damage one file and run again."""
    project = fresh(folder / "damaged", series.reference)
    path = project / name
    if way == "deleted":
        path.unlink()
    else:
        path.write_bytes(damaged(path.read_bytes(), way))
    ear = Ear()
    try:
        reconstruct(series.images, project, reporter=ear)
        wrong = differences(project, series.reference)
    except SemSfmError as error:
        wrong = [str(error)]
    # the bit of a database may be one that no row holds
    said = any(name in line for line in ear.heard) or (name == "database.db" and way == "one bit")
    wrong += [] if said else ["not said"]
    return {"name": name, "way": way, "wrong": wrong}


def rows(results: list[dict[str, object]]) -> Iterator[tuple[object, ...]]:
    """Of the table: way, files, how many were made again."""
    for way in dict.fromkeys(str(r["way"]) for r in results):
        of = [r for r in results if r["way"] == way]
        yield way, len(of), sum(not r["wrong"] for r in of)
