"""IMOD's files of mapped projects, read and applied by an independent reader: what is left in px.

"not held": how far the single-axis files are from the cameras of the project, RMS over all
observations. "sinusoids": distance of the fiducials in the aligned stack from straight sinusoids;
"with x tilts": from one place in the tomogram, with the files in xtilt/; both RMS, and both hold
the noise of the points. Residual and leave-out error are means over the views of the single-axis
files.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import tables
from semsfm_colmap.pipeline.export import export_project
from semsfm_colmap.types import Float
from tests.oracles import tilt_series as reader

HEAD = (
    "series",
    "views",
    "tilts",
    "not held px",
    "sinusoids px",
    "with x tilts px",
    "residual px",
    "leave-out px",
)


def measure(project: Path, folder: Path) -> list[Any]:
    """The row of a project, exported to a new folder."""
    export_project(project, "imod", folder)
    stated = json.loads((folder / "export.json").read_text(encoding="utf-8"))
    sections, _ = reader.read_mrc(folder / "series.st")
    size = sections.shape[2], sections.shape[1]
    tilts = np.array(reader.numbers(folder / "series.tlt"))
    sinusoids = reader.sinusoid_residuals(reader.imod_aligned_fiducials(folder, size))
    views = reader.imod_views(folder / "xtilt")
    with_x_tilts = reader.fiducial_residuals(folder, views, size)
    return [
        project.name,
        len(tilts),
        f"{float(np.ptp(tilts)):.0f} deg",
        f"{stated['rms_deviation_px']:.2f}",
        f"{_rms(sinusoids):.2f}",
        f"{_rms(with_x_tilts):.2f}",
        f"{stated['residual_px']:.2f}",
        f"{stated['leave_out_px']:.2f}",
    ]


def _rms(distance: Float) -> float:
    return float(np.sqrt(np.mean(distance**2)))


def main() -> None:
    """Command line."""
    parser = tables.parser("tilt_files", __doc__)
    parser.add_argument("project", nargs="+", type=Path)
    tables.add_page_option(parser, "tilt_files")
    args = parser.parse_args()
    rows = []
    for project in args.project:
        with tempfile.TemporaryDirectory() as work:
            rows.append(measure(project, Path(work) / "imod"))
    text = tables.table(HEAD, rows)
    print(text)
    if args.markdown:
        tables.put(args.markdown, "tilt_files", text)


if __name__ == "__main__":
    main()
