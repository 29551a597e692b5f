"""Files that an earlier run of the stage left behind."""

from __future__ import annotations

from pathlib import Path


def remove_stale(root: Path, names: set[str], keep: set[str]) -> None:
    """Delete files an earlier run wrote below `root` that this one did not, and empty folders."""
    for name in sorted(names - keep):
        path = root / name
        if Path(name).is_absolute() or ".." in Path(name).parts:
            continue
        path.unlink(missing_ok=True)
        for parent in path.parents:
            if parent == root or not parent.is_dir() or any(parent.iterdir()):
                break
            parent.rmdir()
