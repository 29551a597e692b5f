"""Tilt-series files read and applied after their public descriptions, with plain loops.

IMOD: the manual pages xf2rotmagstr (transforms about the middle of the image), point2model and
3dmod (model coordinates from the lower left corner), tiltalign and tilt (axis vertical,
x' = x cos + z sin). AreTomo: the reading of .aln in its published source, ImodUtil. RELION: its
metadata labels. MRC: the MRC2014 paper. Nothing of the package under test is used.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass
class View:
    """Where it shows a point of the tomogram: ``q = L X + q0`` from its middle, y up."""

    L: np.ndarray
    q0: np.ndarray


def rotation(axis: str, degrees: float) -> np.ndarray:
    """Right-handed about x, y or z."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array(
        {
            "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }[axis]
    )


def numbers(path: Path) -> list[list[float]]:
    return [[float(word) for word in line.split()] for line in path.read_text().splitlines()]


def imod_views(folder: Path, name: str = "series") -> list[View]:
    """From .xf, .tlt and .xtilt: the aligned image undone."""
    views = []
    transforms, tilts, x_tilts = (
        numbers(folder / f"{name}.{kind}") for kind in ("xf", "tlt", "xtilt")
    )
    assert len(transforms) == len(tilts) == len(x_tilts)
    for (a11, a12, a21, a22, dx, dy), (tilt,), (x_tilt,) in zip(
        transforms, tilts, x_tilts, strict=True
    ):
        aligned = (rotation("y", tilt) @ rotation("x", x_tilt))[:2]
        undo = np.linalg.inv(np.array([[a11, a12], [a21, a22]]))
        views.append(View(undo @ aligned, undo @ np.array([-dx, -dy])))
    return views


def imod_aligned_fiducials(folder: Path, size: tuple[int, int]) -> dict[int, np.ndarray]:
    """Rows (tilt in degrees, x, y) from the middle of the aligned image, a table a contour."""
    transforms = numbers(folder / "series.xf")
    tilts = numbers(folder / "series.tlt")
    tracks: dict[int, list[list[float]]] = {}
    for _, contour, x, y, z in numbers(folder / "fiducials.txt"):
        a11, a12, a21, a22, dx, dy = transforms[int(z)]
        x, y = x - size[0] / 2, y - size[1] / 2
        moved = [a11 * x + a12 * y + dx, a21 * x + a22 * y + dy]
        tracks.setdefault(int(contour), []).append([tilts[int(z)][0], *moved])
    return {contour: np.array(rows) for contour, rows in tracks.items()}


def sinusoid_residuals(tracks: dict[int, np.ndarray]) -> np.ndarray:
    """Distances to ``x = X cos + Z sin, y = Y`` with the best X, Y, Z of each track, in px."""
    found = []
    for rows in tracks.values():
        angle = np.radians(rows[:, 0])
        basis = np.column_stack([np.cos(angle), np.sin(angle)])
        solution = np.linalg.lstsq(basis, rows[:, 1], rcond=None)[0]
        found.append(np.hypot(rows[:, 1] - basis @ solution, rows[:, 2] - rows[:, 2].mean()))
    return np.concatenate(found)


def fiducial_residuals(folder: Path, views: list[View], size: tuple[int, int]) -> np.ndarray:
    """Distances in the raw images from the best place in the tomogram of each contour, in px."""
    tracks: dict[int, list[tuple[int, np.ndarray]]] = {}
    for _, contour, x, y, z in numbers(folder / "fiducials.txt"):
        q = np.array([x - size[0] / 2, y - size[1] / 2])
        tracks.setdefault(int(contour), []).append((int(z), q))
    found = []
    for rows in tracks.values():
        A = np.concatenate([views[k].L for k, _ in rows])
        b = np.concatenate([q - views[k].q0 for k, q in rows])
        left = A @ np.linalg.lstsq(A, b, rcond=None)[0] - b
        found.append(np.linalg.norm(left.reshape(-1, 2), axis=1))
    return np.concatenate(found)


def aretomo_views(path: Path) -> list[View]:
    views = []
    for line in path.read_text().splitlines():
        if line.startswith("#"):
            continue
        section, rot, _, tx, ty, *_, tilt = (float(word) for word in line.split())
        assert section == len(views)
        turned = rotation("z", rot) @ rotation("y", tilt)
        views.append(View(turned[:2], np.array([tx, ty])))
    return views


def star_rows(path: Path) -> list[dict[str, str]]:
    """The rows of the one loop of a star file."""
    labels, rows = [], []
    for line in path.read_text().splitlines():
        words = line.split()
        if words and words[0].startswith("_"):
            labels.append(words[0])
        elif labels and words:
            rows.append(dict(zip(labels, words, strict=True)))
    return rows


def relion_views(folder: Path) -> list[View]:
    (tomogram,) = star_rows(folder / "tomograms.star")
    angstrom = float(tomogram["_rlnTomoTiltSeriesPixelSize"])
    views = []
    for row in star_rows(folder / tomogram["_rlnTomoTiltSeriesStarFile"]):
        x, y, z = (float(row[f"_rlnTomo{name}"]) for name in ("XTilt", "YTilt", "ZRot"))
        turned = rotation("z", z) @ rotation("y", y) @ rotation("x", x)
        shift = [float(row[f"_rlnTomo{name}ShiftAngst"]) / angstrom for name in "XY"]
        views.append(View(turned[:2], np.array(shift)))
    return views


def read_mrc(path: Path) -> tuple[np.ndarray, float]:
    """Sections of 16-bit integers, lowest row first, and the pixel size in Angstrom."""
    raw = path.read_bytes()
    width, height, count, mode = struct.unpack_from("<4i", raw, 0)
    assert mode == 1
    (grid,) = struct.unpack_from("<i", raw, 28)
    (cell,) = struct.unpack_from("<f", raw, 40)
    (extended,) = struct.unpack_from("<i", raw, 92)
    data = np.frombuffer(raw, "<i2", width * height * count, 1024 + extended)
    return data.reshape(count, height, width), cell / grid


def leave_out_error(
    linear: np.ndarray, middle: np.ndarray, image: np.ndarray, xy: np.ndarray, left_out: int
) -> np.ndarray:
    """Residual of one observation of a track against the point that the others give: (2,)."""
    rest = [o for o in range(len(image)) if o != left_out]
    A = np.concatenate([linear[image[o]] for o in rest])
    b = np.concatenate([xy[o] - middle[image[o]] for o in rest])
    point = np.linalg.lstsq(A, b, rcond=None)[0]
    i = image[left_out]
    return np.asarray(linear[i] @ point + middle[i] - xy[left_out])
