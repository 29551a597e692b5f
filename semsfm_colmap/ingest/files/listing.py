"""Find the images of a series: recursive, in natural order, safe from loops and odd names."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.files.angles_in_names import signed_order
from semsfm_colmap.ingest.files.mrc import STACK_SUFFIXES, companion_files, is_stack, section_names
from semsfm_colmap.ingest.files.raster import SUFFIXES
from semsfm_colmap.ingest.files.tiff import is_tiff_stack, page_names
from semsfm_colmap.io.layout import FILES, FOLDERS, MASKS_FOLDER, SERIES_FILE
from semsfm_colmap.io.terminal import printable_line
from semsfm_colmap.io.wording import abbreviate

IMAGE_SUFFIXES = tuple(suffix for kind, of in SUFFIXES.items() if kind != "mrc" for suffix in of)


MIN_PAGES = 3
"""A TIFF alone in a folder with fewer pages is one image, with a thumbnail or a second channel."""
OTHER_SUFFIXES = (
    ".dm3", ".dm4", ".emd", ".emi", ".ser", ".jxl", ".heic", ".heif", ".avif", ".psd", ".czi",
    ".lif", ".nd2", ".oib", ".oir", ".vsi", ".tga", ".pgm", ".ppm", ".pnm", ".dng",
    ".hdf5", ".avi", ".mp4",
)  # fmt: skip
"""Images and films in formats that are not read: they are named, not passed over in silence."""


@dataclass(frozen=True, kw_only=True)
class FoundImages:
    """Image files below a folder, as names relative to it with forward slashes."""

    names: tuple[str, ...]
    warnings: tuple[str, ...]


def find_images(image_path: Path, project_path: Path | None = None) -> FoundImages:
    """List the image files below `image_path` in natural order (2 before 10, -10 before -5).

    Of an MRC stack, its sections (`mrc.py`); of a TIFF, its pages (`tiff.py`). A folder that holds
    one stack and nothing else stands for it.

    Folders are followed through symbolic links, each real folder once, so that a loop ends.
    Hidden files, a folder ``masks`` and the outputs of a project are not images of the series,
    also where the project lies inside the image folder.
    """
    from natsort import natsorted

    check_image_path(image_path)
    if is_stack(image_path):
        return FoundImages(names=section_names(image_path), warnings=())
    if is_tiff_stack(image_path):
        return FoundImages(names=page_names(image_path), warnings=())
    skip = {(project_path / name).resolve() for name in FOLDERS} if project_path else set()
    names: list[str] = []
    warnings: list[str] = []
    seen: set[tuple[int, int]] = set()
    other: list[str] = []
    stacks: list[str] = []

    def unreadable(error: OSError) -> None:
        warnings.append(f"{error.filename}: the folder cannot be read ({error.strerror}); skipped.")

    for folder, folders, files in os.walk(image_path, followlinks=True, onerror=unreadable):
        status = os.stat(folder)
        if (status.st_dev, status.st_ino) in seen:
            folders.clear()
            continue
        seen.add((status.st_dev, status.st_ino))
        at_top = Path(folder) == image_path
        if SERIES_FILE in files and not (at_top and not any(map(_is_image, files))):
            # Another project lies here, with prepared copies of images.
            folders[:] = [name for name in folders if name not in FOLDERS]
        folders[:] = sorted(
            name
            for name in folders
            if not name.startswith(".")
            and not (at_top and name == MASKS_FOLDER)
            and Path(folder, name).resolve() not in skip
        )
        for file in files:
            if not _is_image(file):
                name = Path(folder, file).relative_to(image_path).as_posix()
                other += [_shown(name)] if file.lower().endswith(OTHER_SUFFIXES) else []
                stacks += [name] if is_stack(Path(folder, file)) else []
                continue
            name = Path(folder, file).relative_to(image_path).as_posix()
            reason = _why_not(Path(folder, file), name)
            if reason:
                warnings.append(f"{_shown(name)}: {reason}")
            else:
                names.append(name)
    if other:
        warnings.append(
            f"{abbreviate(natsorted(other))}: passed over, the format is not read; save as TIFF or "
            "PNG to use them."
        )
    if names and stacks:
        warnings.append(
            f"{abbreviate([_shown(name) for name in stacks])}: passed over, a stack is a series of "
            "its own; give it as such."
        )
    if len(stacks) == 1 and not names:
        sections = section_names(image_path / stacks[0])
        names = [f"{stacks[0]}/{section}" for section in sections]
    if len(names) == 1 and is_tiff_stack(image_path / names[0]):
        pages = page_names(image_path / names[0])
        names = [f"{names[0]}/{page}" for page in pages] if len(pages) >= MIN_PAGES else names
    ordered = natsorted(names)
    ordered = signed_order(ordered) or ordered
    return FoundImages(names=tuple(ordered), warnings=tuple(sorted(warnings)))


def _is_image(file: str) -> bool:
    return not file.startswith(".") and file.lower().endswith(IMAGE_SUFFIXES)


def source_files(image_path: Path, project_path: Path | None = None) -> list[Path]:
    """All files that a run may read: those below a folder, or a stack and what lies beside it.

    Parameters
    ----------
    project_path : is passed by where it lies below the folder; None: there is none

    """
    if is_stack(image_path):
        return [image_path, *companion_files(image_path)]
    if is_tiff_stack(image_path):
        return [image_path]
    return files_below(image_path, project_path)


def files_below(folder: Path, without: Path | None = None) -> list[Path]:
    """All files below a folder in a fixed order, links followed, each real folder once.

    Parameters
    ----------
    without : a project, which may lie below or be the folder itself: its files are passed by

    """
    project = None if without is None else without.resolve()
    skipped = set() if project is None else {project, *(project / name for name in FOLDERS)}
    found: list[Path] = []
    seen: set[tuple[int, int]] = set()
    for place, folders, files in os.walk(folder, followlinks=True):
        status = os.stat(place)
        if (status.st_dev, status.st_ino) in seen:
            folders.clear()
            continue
        seen.add((status.st_dev, status.st_ino))
        folders[:] = sorted(
            name
            for name in folders
            if not name.startswith(".") and Path(place, name).resolve() not in skipped
        )
        own = FILES if project is not None and Path(place).resolve() == project else ()
        found += [Path(place, name) for name in files if not name.startswith(own)]
    return sorted(found)


def check_image_path(image_path: Path) -> None:
    """Refuse what is neither a stack nor a folder that can be listed."""
    if not image_path.exists():
        raise UsageError(f"{image_path} does not exist; give the folder that holds the images.")
    if not image_path.is_dir() and not is_stack(image_path) and not is_tiff_stack(image_path):
        if image_path.name.lower().endswith(OTHER_SUFFIXES):
            raise UsageError(
                f"{image_path}: {image_path.suffix} files are not read; save the images as TIFF or "
                "PNG into a folder and give that."
            )
        raise UsageError(
            f"{image_path} is not a folder; give the folder that holds the images, or an MRC stack "
            f"({', '.join(STACK_SUFFIXES)}), or a TIFF with a page for each."
        )
    if not os.access(image_path, os.R_OK if image_path.is_file() else os.R_OK | os.X_OK):
        raise UsageError(f"{image_path} cannot be read: permission denied; change its permissions.")


def _why_not(path: Path, name: str) -> str | None:
    """The reason a directory entry with an image's suffix is not an image of the series."""
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        return "the name is not valid UTF-8, which COLMAP needs; left out, rename the file."
    if any(ord(c) < 32 or ord(c) == 127 for c in name):
        return "the name has control characters; left out, rename the file."
    try:
        status = path.stat()
    except OSError as error:
        return f"a link that leads nowhere ({error.strerror}); left out."
    if not stat.S_ISREG(status.st_mode):
        return "not a regular file; left out."
    return None


def _shown(name: str) -> str:
    """A name that may hold anything, fit for a message."""
    return printable_line(name)
