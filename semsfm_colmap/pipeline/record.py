"""run.json: what ran, on what, with which options, how long; the basis of skipping stages."""

from __future__ import annotations

import hashlib
import json
import platform
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal, TypeVar

from semsfm_colmap.io.atomic import write_json
from semsfm_colmap.io.versions import check_version
from semsfm_colmap.records import StageRecord, from_plain, to_plain
from semsfm_colmap.version import __version__

FORMAT = "semsfm-run"
VERSION = 1
PACKAGES = ("numpy", "scipy", "numba", "pycolmap", "opencv-python-headless", "open3d-cpu", "open3d")

R = TypeVar("R")


@dataclass(frozen=True, kw_only=True)
class StageEntry:
    """The last run of one stage."""

    status: Literal["running", "done", "failed", "stale"] = "stale"
    key: str = ""
    """of its inputs and options"""
    product: str = ""
    """what later stages depend on; empty: the key"""
    outputs: Mapping[str, str] = field(default_factory=dict)
    """fingerprints of the files that it has left, by name, and of its part of the database"""
    seconds: float = 0.0
    peak_memory_mb: float = 0.0
    summary: Mapping[str, Any] = field(default_factory=dict)
    """the stage's record, see `semsfm_colmap.records`"""

    @property
    def for_later_stages(self) -> str:
        """The key that later stages see."""
        return self.product or self.key

    def with_note(self, note: str) -> StageEntry:
        """The same entry with one more thing to say."""
        notes = [*self.summary.get("notes", []), note]
        return replace(self, summary={**self.summary, "notes": notes})

    @classmethod
    def done(cls, key: str, seconds: float, record: StageRecord, product: str = "") -> StageEntry:
        """The entry of a stage that has ended now."""
        return cls(
            status="done",
            key=key,
            product=product,
            seconds=seconds,
            peak_memory_mb=peak_memory_mb(),
            summary=to_plain(record),
        )


@dataclass
class RunRecord:
    """The content of run.json; `stages` maps a stage to its last run."""

    path: Path
    stages: dict[str, StageEntry] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    image_path: str = ""
    seed: int = 0
    options: dict[str, Any] = field(default_factory=dict)
    """those of the last run, as semsfm.toml has them"""

    @classmethod
    def read(cls, path: Path) -> RunRecord:
        """The record of a project, empty when there is none or it cannot be read.

        Raises
        ------
        InputError
            A newer version of the program has made the project.

        """
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return cls(path=path)
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            return cls(path=path)
        check_version(data, VERSION, path, "remove it, and the stages are run again")
        entries = {
            name: from_plain(StageEntry, entry) for name, entry in data.get("stages", {}).items()
        }
        return cls(
            path=path,
            stages={name: entry for name, entry in entries.items() if entry is not None},
            inputs=dict(data.get("inputs", {})),
            image_path=str(data.get("image_path", "")),
            seed=int(data.get("seed", 0)),
            options=dict(data.get("options", {})),
        )

    def __repr__(self) -> str:
        """A line a stage."""
        lines = [f"{name}: {e.status}, {e.seconds:.1f} s" for name, e in self.stages.items()]
        return "\n  ".join([f"RunRecord({self.path}", *lines]) + "\n)"

    def write(self) -> None:
        """Write run.json, whole."""
        data = {
            "format": FORMAT,
            "version": VERSION,
            "image_path": self.image_path,
            "seed": self.seed,
            "versions": versions(),
            "options": self.options,
            "stages": {name: asdict(entry) for name, entry in self.stages.items()},
            "inputs": self.inputs,
        }
        write_json(data, self.path)

    def entry(self, name: str) -> StageEntry:
        """The last run of a stage, an empty one when it never ran."""
        return self.stages.get(name, StageEntry())

    def is_done(self, name: str, key: str) -> bool:
        """Whether the stage finished with these inputs and options."""
        entry = self.entry(name)
        return entry.status == "done" and entry.key == key

    def result(self, name: str, kind: type[R]) -> R | None:
        """What a stage has left behind; None when it never ran to its end."""
        return from_plain(kind, self.entry(name).summary)

    def notes(self) -> list[str]:
        """The sentences of all stages, in their order."""
        return [note for e in self.stages.values() for note in e.summary.get("notes", [])]


def versions() -> dict[str, str]:
    """Versions of the program and the libraries that shape its results."""
    result = {"semsfm_colmap": __version__, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            result[package] = version(package)
        except PackageNotFoundError:
            continue
    return result


def hash_text(*parts: str) -> str:
    """A short key of texts."""
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(part.encode("utf-8", "surrogateescape"))  # a path may be any bytes
        digest.update(b"\0")
    return digest.hexdigest()


def hash_file(path: Path) -> str:
    """A key of a file's content."""
    digest = hashlib.blake2b(digest_size=16)
    with path.open("rb") as file:
        while chunk := file.read(1 << 20):
            digest.update(chunk)
    return digest.hexdigest()


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far; 0 on Windows, which does not say."""
    try:
        import resource
    except ImportError:
        return 0.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1 << 20 if sys.platform == "darwin" else 1 << 10)
