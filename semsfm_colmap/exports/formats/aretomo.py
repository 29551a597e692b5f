"""AreTomo's alignment file .aln, after its published source (AreTomo2, CSaveAlignFile, CSaveXF).

A line a view: section from 0, ROT the tilt axis from the vertical, counterclockwise, (TX, TY) the
image of the rotation centre from the image's middle in px of the raw stack, TILT in degrees; the
aligned image is ``p = R_2(-ROT) (q - (TX, TY))``. GMAG and the columns after TY are not used.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.exports.tilt_files import (
    NAME,
    errors_of,
    out_of_plane_words,
    summary,
    write_stack,
    write_views,
)
from semsfm_colmap.exports.tilt_series import held_cameras, tilt_series

COLUMNS = (
    "# SEC     ROT         GMAG       TX          TY      SMEAN     SFIT    SCALE     BASE     TILT"
)


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """series.mrc, series.aln, views.csv"""
    series = tilt_series(scene)
    held = held_cameras(series, scene, series.single_axis_rigid)
    errors = errors_of(series, held, scene)
    width, height = series.size_px
    lines = [
        "# AreTomo Alignment / Priims bprmMn",
        f"# RawSize = {width} {height} {len(scene.names)}",
        "# NumPatches = 0",
        COLUMNS,
    ]
    for k, (tx, ty) in enumerate(held.middle_px):
        lines.append(
            f"{k:5d}  {np.degrees(series.rotation_rad[k]):10.5f}  {1.0:9.5f}  {tx:10.4f}  "
            f"{ty:10.4f}  {1.0:7.2f}  {1.0:7.2f}  {1.0:7.2f}  {0.0:7.2f}  "
            f"{np.degrees(series.tilt_rad[k]):10.5f}"
        )
    (folder / f"{NAME}.aln").write_text("\n".join(lines) + "\n", encoding="utf-8")
    write_stack(series, scene, folder / f"{NAME}.mrc")
    write_views(series, scene, held, errors, folder / "views.csv")
    spread = 100.0 * float(np.ptp(series.magnification))
    dropped = f"{out_of_plane_words(series)}, nor magnifications, which span {spread:.2g} %"
    return summary(series, scene, held, errors, dropped)
