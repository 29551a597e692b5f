"""run.json: what ran, on what, with which options, how long; the basis of skipping stages."""

from __future__ import annotations

import hashlib
import json
import platform
import resource
import sys
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import semsfm_colmap
from semsfm_colmap.io.atomic import write_json

FORMAT = "semsfm-run"
VERSION = 1
PACKAGES = ("numpy", "scipy", "numba", "pycolmap", "opencv-python-headless", "open3d-cpu", "open3d")


@dataclass
class RunRecord:
    """The content of run.json; `stages` maps a stage to its last finished run."""

    path: Path
    stages: dict[str, dict[str, Any]] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    image_path: str = ""
    seed: int = 0

    @classmethod
    def read(cls, path: Path) -> RunRecord:
        """The record of a project, empty when there is none or it cannot be read."""
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return cls(path=path)
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            return cls(path=path)
        return cls(
            path=path,
            stages=dict(data.get("stages", {})),
            inputs=dict(data.get("inputs", {})),
            image_path=str(data.get("image_path", "")),
            seed=int(data.get("seed", 0)),
        )

    def write(self) -> None:
        """Write run.json, whole."""
        data = {
            "format": FORMAT,
            "version": VERSION,
            "image_path": self.image_path,
            "seed": self.seed,
            "versions": versions(),
            "stages": self.stages,
            "inputs": self.inputs,
        }
        write_json(data, self.path)

    def is_done(self, name: str, key: str) -> bool:
        """Whether the stage finished with these inputs and options."""
        stage = self.stages.get(name, {})
        return stage.get("status") == "done" and stage.get("key") == key


def versions() -> dict[str, str]:
    """Versions of the program and the libraries that shape its results."""
    result = {"semsfm_colmap": semsfm_colmap.__version__, "python": platform.python_version()}
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
    """Largest resident memory of this process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1 << 20 if sys.platform == "darwin" else 1 << 10)
