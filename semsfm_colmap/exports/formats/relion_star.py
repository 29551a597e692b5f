"""RELION 5's tilt series: tomograms.star and tilt_series/series.star.

After RELION's documentation of its metadata labels: ``q = S + R_z(ZRot) R_y(YTilt) R_x(XTilt) X``
with right-handed extrinsic rotations of the specimen about its middle, q and the shift S from the
image's middle, S in Angstrom. Each view has three angles of its own, so that every rotation is
held; magnifications are not. Voltage, defocus and dose belong to transmission microscopes and are
left out.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.exports.tilt_files import (
    NAME,
    errors_of,
    pixel_angstrom,
    summary,
    write_stack,
    write_views,
)
from semsfm_colmap.exports.tilt_series import held_cameras, tilt_series


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """series.mrcs, tomograms.star, tilt_series/series.star, views.csv"""
    series = tilt_series(scene)
    angstrom = pixel_angstrom(series, scene)
    if angstrom is None:
        raise InputError(
            "relion-star has lengths in Angstrom and this model is in px: give --pixel_size_um to "
            "`semsfm reconstruct`, or use imod or aretomo"
        )
    held = held_cameras(series, scene, series.rigid)
    errors = errors_of(series, held, scene)
    angles = np.degrees(series.euler_zyx_rad)
    shift = angstrom * held.middle_px
    tilt = np.degrees(series.tilt_rad)
    nominal = tilt if scene.tilt_rad is None else np.degrees(scene.tilt_rad)
    rows = []
    for k in range(len(scene.names)):
        stage = nominal[k] if np.isfinite(nominal[k]) else tilt[k]
        values = [stage, *angles[k], *shift[k]]
        rows.append([f"{k + 1:06d}@{NAME}.mrcs", *(f"{value:.6f}" for value in values)])
    labels = (
        "MicrographName", "TomoNominalStageTiltAngle", "TomoXTilt", "TomoYTilt", "TomoZRot",
        "TomoXShiftAngst", "TomoYShiftAngst",
    )  # fmt: skip
    (folder / "tilt_series").mkdir()
    _write_star(folder / "tilt_series" / f"{NAME}.star", NAME, labels, rows)
    sizes = (f"{angstrom:.6f}", f"{angstrom:.6f}", *map(str, series.tomogram_size_px))
    labels = (
        "TomoName", "TomoTiltSeriesStarFile", "MicrographOriginalPixelSize",
        "TomoTiltSeriesPixelSize", "TomoSizeX", "TomoSizeY", "TomoSizeZ",
    )  # fmt: skip
    _write_star(
        folder / "tomograms.star", "global", labels, [[NAME, f"tilt_series/{NAME}.star", *sizes]]
    )
    write_stack(series, scene, folder / f"{NAME}.mrcs")
    write_views(series, scene, held, errors, folder / "views.csv")
    spread = 100.0 * float(np.ptp(series.magnification))
    dropped = f"magnifications, which span {spread:.2g} %"
    return summary(series, scene, held, errors, dropped)


def _write_star(path: Path, block: str, labels: tuple[str, ...], rows: list[list[str]]) -> None:
    lines = ["# version 50001", "", f"data_{block}", "", "loop_"]
    lines += [f"_rln{label} #{k + 1}" for k, label in enumerate(labels)]
    lines += [" ".join(row) for row in rows]
    path.write_text("\n".join(lines) + "\n\n", encoding="utf-8")
