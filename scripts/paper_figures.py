"""The figures of the paper from our own projects, and the tables of docs/paper.md with them.

    python scripts/paper_figures.py --nickel P --pollen P --spore P [--pollen_pixel_nm 64.7]

The tables are those of `python -m benchmarks.paper`, which says what the projects are; the figures
go into docs/images/paper, the tables into docs/paper.md.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import PIL.Image

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks import paper, tables  # noqa: E402
from semsfm_colmap.colmap.model.sparse import read_model  # noqa: E402
from semsfm_colmap.io.ply import read_ply_mesh  # noqa: E402
from semsfm_colmap.surface.mesh.preview import render_mesh, turntable  # noqa: E402

PAGE = ROOT / "docs/paper.md"
FIGURES = ROOT / "docs/images/paper"
WIDTH_PX = 900
VIEW_PX = (440, 360)


def copy_figure(project: Path, name: str, target: Path) -> None:
    """A figure of the report at the width of the page, in few colours."""
    figure = PIL.Image.open(project / f"report/figures/{name}.png").convert("RGB")
    height = round(figure.height * WIDTH_PX / figure.width)
    small = figure.resize((WIDTH_PX, height), PIL.Image.Resampling.LANCZOS)
    save(small, target)


def mesh_figure(project: Path, target: Path) -> None:
    """The mesh as the middle image sees it, and turned by 50 degrees."""
    model = read_model(project / "sparse/0")
    mesh = read_ply_mesh(project / "mesh/mesh.ply")
    R = np.asarray(model.cameras.cam_from_world[model.num_images // 2])
    views = (R, turntable(R, np.array([50.0]))[0])
    panels = [render_mesh(mesh, view, size_px=VIEW_PX) for view in views]
    save(PIL.Image.fromarray(np.concatenate(panels, axis=1)), target)


def save(image: PIL.Image.Image, target: Path) -> None:
    """Write a PNG with 64 colours."""
    target.parent.mkdir(parents=True, exist_ok=True)
    image.quantize(64, dither=PIL.Image.Dither.NONE).save(target, optimize=True)


def draw(nickel: Path, pollen: Path, spore: Path, folder: Path) -> None:
    """All figures."""
    copy_figure(pollen, "visibility", folder / "figure1.png")
    copy_figure(pollen, "matches", folder / "figure14.png")
    copy_figure(pollen, "residual_histograms", folder / "figure15.png")
    copy_figure(pollen, "scene", folder / "figure16.png")
    copy_figure(spore, "scene", folder / "figure17.png")
    mesh_figure(nickel, folder / "figure18.png")
    mesh_figure(pollen, folder / "figure19.png")
    mesh_figure(spore, folder / "spore.png")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    paper.add_project_options(parser)
    parser.add_argument("--page", type=Path, default=PAGE)
    parser.add_argument("--figures", type=Path, default=FIGURES)
    given = parser.parse_args()
    for command, text in paper.all_tables(given).items():
        tables.put(given.page, command, text)
    draw(given.nickel, given.pollen, given.spore, given.figures)


if __name__ == "__main__":
    main()
