"""What other programs report of a project: the table of docs/exports.md.

Runs COLMAP's command line (3.8 from Debian; its rows are left out without it), pycolmap and open3d
on copies of finished projects with depth maps, and the readers of tests/exports on the
exported folders. tests/exports/test_consumers.py asserts the same on a small project.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from benchmarks import tables
from semsfm_colmap.colmap.database.schema38 import write_database_38
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.pipeline.export import export_project
from semsfm_colmap.types import Array
from tests.exports import consumers, readers

HEAD = ("program", "step", "images", "points", "mean error px", "")


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    program: str
    step: str
    figures: consumers.Figures | None
    note: str = ""

    def cells(self) -> list[str]:
        """As the table has them."""
        numbers = ["", "", ""]
        if self.figures is not None:
            f = self.figures
            numbers = [
                str(f.num_images) if f.num_images else "",
                str(f.num_points),
                "" if math.isnan(f.mean_error_px) else f"{f.mean_error_px:.4f}",
            ]
        return [self.program, self.step, *numbers, self.note]


def model_rows(project: Path, work: Path) -> list[Row]:
    """Everything that reads the sparse model."""
    model, images = project / "sparse" / "0", project / "images"
    made = read_model(model)
    size = tuple(int(v) for v in made.image_size_px[0])
    rows = [Row("semsfm", "orthographic cameras of the sidecar", consumers.own_figures(made))]

    def add(program: str, step: str, run: Callable[[], consumers.Figures], note: str = "") -> None:
        rows.append(Row(program, step, run(), note))

    def turned(folder: Path) -> str:
        return f"cameras turn by at most {consumers.rotation_change_deg(model, folder):.4f} deg"

    if consumers.has_colmap():
        name = "colmap 3.8"
        add(name, "model_analyzer", lambda: consumers.cli_analyze(model))
        for kind in ("TXT", "NVM", "Bundler", "PLY"):
            out = work / kind

            def convert(kind: str = kind, out: Path = out) -> consumers.Figures:
                return consumers.cli_convert(model, kind, out, (size[0], size[1]))

            add(name, f"model_converter to {kind}", convert)
        out = work / "ba38"
        add(name, "bundle_adjuster", lambda: consumers.cli_bundle_adjust(model, work / "ba38"))
        rows[-1] = Row(*(rows[-1].program, rows[-1].step, rows[-1].figures), turned(out))
        database = work / "d38.db"
        write_database_38(project / "database.db", database)
        add(
            name,
            "point_triangulator",
            lambda: consumers.cli_triangulate(model, database, images, work / "tri38"),
            "from the matches: other tracks",
        )
        add(
            name,
            "image_undistorter",
            lambda: consumers.cli_undistort(model, images, work / "und38"),
        )
    name = f"pycolmap {version('pycolmap')}"
    add(name, "read", lambda: consumers.figures(consumers.read(model)))
    add(name, "bundle_adjustment", lambda: consumers.py_bundle_adjust(model, work / "ba4"))
    rows[-1] = Row(*(rows[-1].program, rows[-1].step, rows[-1].figures), turned(work / "ba4"))
    add(
        name,
        "triangulate_points",
        lambda: consumers.py_triangulate(model, project / "database.db", images, work / "tri4"),
        "from the matches: other tracks",
    )
    add(name, "undistort_images", lambda: consumers.py_undistort(model, images, work / "und4"))
    return rows


def dense_rows(project: Path, work: Path) -> list[Row]:
    """Everything that reads the dense workspace."""
    folder = work / "colmap-dense"
    summary = export_project(project, "colmap-dense", folder)
    if not summary["num_depth_maps"]:
        return []
    preset = consumers.preset_of(summary)
    made = read_model(project / "sparse" / "0")
    scale = float(np.median(made.cameras.scale_px_per_unit))
    own = project / "dense" / "fused.ply"
    rows = []

    def count(number: int) -> consumers.Figures:
        return consumers.Figures(0, number, float("nan"))

    def across(path: Path) -> str:
        gap = consumers.surface_gap_px(path, own, scale)
        return f"{np.median(np.abs(gap)):.2f} px from our fused surface (median)"

    fused = consumers.py_fuse(folder, preset)
    name = f"pycolmap {version('pycolmap')}"
    note = across(folder / "fused.ply")
    rows.append(Row(name, "stereo_fusion of our maps", count(fused), note))
    faces = consumers.py_poisson(folder / "fused.ply", work / "poisson.ply")
    rows.append(Row(name, "poisson_meshing", None, f"{faces} faces"))
    if consumers.has_colmap():
        fused = consumers.cli_fuse(folder, preset)
        note = across(folder / "fused_cli.ply")
        rows.append(Row("colmap 3.8", "stereo_fusion of our maps", count(fused), note))
        faces = consumers.cli_poisson(folder / "fused_cli.ply", work / "poisson38.ply")
        rows.append(Row("colmap 3.8", "poisson_mesher", None, f"{faces} faces"))
    name = f"open3d {open3d_version()}"
    vertices = consumers.open3d_tsdf(folder, preset, 2.0 / scale)
    write_points(work / "tsdf.ply", vertices)
    note = f"{len(vertices)} vertices, {across(work / 'tsdf.ply')}"
    rows.append(Row(name, "TSDF of our maps", None, note))
    return rows


def folder_rows(project: Path, work: Path) -> list[Row]:
    """Folders that readers written from the programs' documentation accept."""
    rows = []
    ply = export_project(project, "ply", work / "ply")
    num = len(consumers.open3d_cloud(work / "ply" / "points.ply"))
    assert num == ply["num_points"]
    figures = consumers.Figures(0, num, float("nan"))
    rows.append(Row(f"open3d {open3d_version()}", "points.ply", figures))
    for name, program, accept in (
        ("colmap-float32", "gsplat, OpenSplat (reader)", readers.splatting_folder),
        ("openmvs", "OpenMVS (reader)", readers.openmvs_folder),
    ):
        summary = export_project(project, name, work / name)
        scene = accept(work / name)
        note = (
            f"k = {summary['focal_factor']:.0f}, {summary['max_deviation_px']:.3f} px from "
            "parallel projection at most"
        )
        rows.append(Row(program, name, consumers.scene_figures(scene), note))
    summary = export_project(project, "nerfstudio", work / "nerfstudio")
    views, _ = readers.read_transforms(work / "nerfstudio")
    figures = consumers.Figures(len(views), summary["num_points"], float("nan"))
    rows.append(Row("nerfstudio (reader)", "nerfstudio", figures))
    return rows


def open3d_version() -> str:
    """Of whichever wheel is installed."""
    import open3d

    return str(open3d.__version__)


def write_points(path: Path, points: Array) -> None:
    """As PLY, which `surface_gap_px` reads."""
    from semsfm_colmap.io.ply import write_ply
    from semsfm_colmap.types import PointCloud

    write_ply(path, PointCloud(points=points))


def table(project: Path) -> str:
    """All rows of a project as Markdown."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        copy = work / "project"
        shutil.copytree(project, copy, ignore=shutil.ignore_patterns("mesh", "report", "export"))
        rows = model_rows(copy, work) + dense_rows(copy, work) + folder_rows(copy, work)
    return tables.table(HEAD, [row.cells() for row in rows])


def main() -> None:
    """Command line."""
    parser = tables.parser("consumers", __doc__)
    parser.add_argument("projects", nargs="+", type=Path, metavar="PROJECT")
    tables.add_page_option(parser, "consumers", flag="--write")
    arguments = parser.parse_args()
    text = "\n\n".join(f"**{path.name}**\n\n{table(path)}" for path in arguments.projects)
    print(text)
    if arguments.markdown is not None:
        tables.put(arguments.markdown, "consumers", text)


if __name__ == "__main__":
    main()
