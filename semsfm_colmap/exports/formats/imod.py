"""IMOD: the files of an aligned etomo directory, after IMOD's manual pages.

Transforms (xf2rotmagstr): ``x' = a11 (x - xc) + a12 (y - yc) + dx + xc``, likewise y', about the
image's middle, a line ``a11 a12 a21 a22 dx dy`` a view. Model coordinates (3dmod): origin in the
lower left corner, the middle of the first pixel at 0.5, z the section from 0. Tilt axis vertical in
the aligned stack, tilts right-handed about y with z toward the viewer (tiltalign, tilt).

xtilt/ holds the same alignment with the tilt about x of every view that the main files leave out:
``P_i B^T = R_z R_y(tilt) R_x(x tilt)`` has one for any rotation.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.exports.fiducials import ViewErrors, longest_tracks
from semsfm_colmap.exports.imod_model import open_contour_model
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.exports.tilt_files import (
    NAME,
    errors_of,
    out_of_plane_words,
    pixel_angstrom,
    summary,
    write_stack,
    write_views,
)
from semsfm_colmap.exports.tilt_series import TiltSeries, held_cameras, measured_px, tilt_series
from semsfm_colmap.types import Float

IDENTITY = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0])


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """series.st, .xf, .tlt, .rawtlt, .xtilt, .prexg, .fid, xtilt/, taSolution.log, fiducials.txt"""
    series = tilt_series(scene)
    held = held_cameras(series, scene, series.single_axis)
    errors = errors_of(series, held, scene)
    num_views = len(scene.names)
    no_x_tilt = np.stack([np.zeros(num_views), series.tilt_rad, series.rotation_rad], axis=1)
    _write_alignment(series, no_x_tilt, held.middle_px, folder)
    (folder / "xtilt").mkdir()
    _write_alignment(series, series.euler_zyx_rad, series.middle_px, folder / "xtilt")
    write_stack(series, scene, folder / f"{NAME}.st")
    _write_transforms(folder / f"{NAME}.prexg", np.tile(IDENTITY, (num_views, 1)))
    recorded = scene.tilt_rad
    if recorded is not None and np.isfinite(recorded).all():
        _write_angles(folder / f"{NAME}.rawtlt", np.degrees(recorded))
    num_fiducials = _write_fiducials(series, scene, folder, options)
    _write_solution(series, scene, errors, folder / "taSolution.log")
    write_views(series, scene, held, errors, folder / "views.csv")
    (folder / "commands.txt").write_text(_commands(series), encoding="utf-8")
    return {
        **summary(series, scene, held, errors, out_of_plane_words(series)),
        "num_fiducials": num_fiducials,
    }


def _write_alignment(series: TiltSeries, xyz_rad: Float, middle_px: Float, folder: Path) -> None:
    """series.xf, .tlt, .xtilt from angles about x, y and z (M, 3) and images of the middle."""
    A = series.turned_back(xyz_rad[:, 2])
    shift = -np.einsum("mij,mj->mi", A, middle_px)
    _write_transforms(folder / f"{NAME}.xf", np.hstack([A.reshape(-1, 4), shift]))
    _write_angles(folder / f"{NAME}.tlt", np.degrees(xyz_rad[:, 1]))
    _write_angles(folder / f"{NAME}.xtilt", np.degrees(xyz_rad[:, 0]))


def _write_transforms(path: Path, rows: Float) -> None:
    np.savetxt(path, rows, fmt="%12.8f %12.8f %12.8f %12.8f %12.4f %12.4f")


def _write_angles(path: Path, degrees: Float) -> None:
    np.savetxt(path, degrees, fmt="%10.5f")


def _write_fiducials(
    series: TiltSeries, scene: ExportScene, folder: Path, options: FormatOptions
) -> int:
    """The longest tracks, a contour each: a model, and lines ``object contour x y z``."""
    image, track, xy = measured_px(series, scene)
    chosen = longest_tracks(track, options.max_fiducials)
    rows = np.isin(track, chosen)
    contour = np.searchsorted(chosen, track[rows]) + 1
    corner = xy[rows] + np.array(series.size_px) / 2.0
    table = np.column_stack([np.ones(len(contour)), contour, corner, image[rows]])
    np.savetxt(folder / "fiducials.txt", table, fmt="%d %d %.4f %.4f %d")
    contours = [table[contour == k, 2:] for k in range(1, len(chosen) + 1)]
    size_px = (*series.size_px, len(scene.names))
    (folder / f"{NAME}.fid").write_bytes(open_contour_model(contours, size_px))
    return len(chosen)


def _write_solution(series: TiltSeries, scene: ExportScene, errors: ViewErrors, path: Path) -> None:
    """The table of views that tiltalign prints; residuals in nm where the pixel size is known."""
    angstrom = pixel_angstrom(series, scene)
    unit, factor = ("resid-nm", angstrom / 10.0) if angstrom else ("mean resid", 1.0)
    tilt = np.degrees(series.tilt_rad)
    recorded = tilt if scene.tilt_rad is None else np.degrees(scene.tilt_rad)
    deltilt = np.where(np.isfinite(recorded), tilt - recorded, 0.0)
    lowest = int(np.argmin(np.abs(tilt)))
    lines = [
        f" At minimum tilt, rotation angle is {np.degrees(series.rotation_rad[lowest]):8.2f}",
        "",
        f" view   rotation    tilt    deltilt     mag      dmag      skew    {unit}",
    ]
    for k in range(len(tilt)):
        lines.append(
            f"{k + 1:4d} {np.degrees(series.rotation_rad[k]):10.2f} {tilt[k]:9.2f} "
            f"{deltilt[k]:9.2f} {series.magnification[k]:10.4f} {0.0:9.4f} {0.0:8.2f} "
            f"{factor * errors.residual_px[k]:10.2f}"
        )
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _commands(series: TiltSeries) -> str:
    """The commands that align the stack and reconstruct the tomogram."""
    width, height, thickness = series.tomogram_size_px
    return (
        f"newstack -input {NAME}.st -output {NAME}_ali.mrc -xform {NAME}.xf -float 2 "
        f"-size {width},{height}\n"
        f"tilt -input {NAME}_ali.mrc -output {NAME}_full_rec.mrc -TILTFILE {NAME}.tlt "
        f"-XTILTFILE {NAME}.xtilt -THICKNESS {thickness}\n"
    )
