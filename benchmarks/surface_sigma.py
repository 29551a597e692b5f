"""Do the error bars of the surface hold? |error| / sigma on rendered series with exact truth.

Every series is rendered, mapped, densified and meshed without options. The mesh is aligned to the
truth by the cameras alone; the error of a vertex is its signed distance to the true surface. Given
are robust scales of error / sigma: 1.4826 times the median of its absolute value, and the value
that 68.3 % of the vertices stay below; both are 1 for a Gaussian error of that sigma. In the tenths
of the vertices with the smallest and the largest sigmas the error is the former scale of it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tables import add_page_option, parser, put, table
from benchmarks.truth.measured import rendered
from benchmarks.truth.series import TEST, TRAIN, Series
from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError
from semsfm_colmap.evaluation.distance import Surface
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.geometry.alignment import align_cameras_both_hands
from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.io.ply import read_ply_cloud, read_ply_mesh
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.types import Float

COMMAND = "surface_sigma"
STAGES = ("ingest", "extract", "match", "map", "densify", "mesh")
ONE_SIGMA = 0.6827
TENTH = 0.1
"""Vertices that are compared with those at the other end of the sigmas."""
LEAST_SHARE = 0.002
"""An octave with a smaller share of the vertices is not a row of its own."""
CHOSEN = {
    "grain_101_24x115_usual", "grain_102_12x60_usual", "grain_104_24x115_strong",
    "grain_110_24x115_albedo", "grain_111_18x85_weak", "grain_113_24x115_none",
    "clump_105_24x115_usual", "clump_114_12x45_strong", "field_107_13x60_usual",
    "field_116_21x80_strong",
}  # fmt: skip
"""The series that the constants of `surface/fusion/error_bars.py` were fitted to."""
HEAD = (
    "series", "vertices", "error px: median", "abs median", "95 %", "sigma px",
    "least sure tenth: sigma, error", "surest tenth: sigma, error",
    "scale of error / sigma", "68 %", "cloud: scale",
)  # fmt: skip


def judged(project: Path, series: Path) -> dict[str, Any]:
    """Errors and sigmas, in px, of the mesh and the cloud of a project.

    Raises
    ------
    InputError
        When the model is of the wrong hand: its surface has no distance to the truth.

    """
    home = Project(project)
    model = home.read_main_model()
    truth = load_truth(series)
    number = {Path(name).stem: i for i, name in enumerate(truth.names)}
    true = truth.cameras.select(np.array([number[Path(n).stem] for n in model.image_names]))
    right, wrong = align_cameras_both_hands(model.cameras, true)
    if wrong.rotation_rms_rad < right.rotation_rms_rad:
        raise InputError(f"{project}: the model has the wrong hand")
    assert truth.mesh is not None
    surface = Surface(truth.mesh)
    surface.orient(truth.cameras, truth.image_size_px)
    T, px = right.true_from_estimated, truth.scale_px_per_unit
    mesh, cloud = read_ply_mesh(home.mesh / "mesh.ply"), read_ply_cloud(home.dense / "fused.ply")
    assert mesh.vertex_sigma is not None
    assert cloud.sigma is not None
    return {
        "error": px * surface.signed_distance(T.apply(mesh.vertices)),
        "sigma": px * T.scale * mesh.vertex_sigma,
        "cloud_error": px * surface.signed_distance(T.apply(cloud.points)),
        "cloud_sigma": px * T.scale * cloud.sigma,
    }


def scales(error: Float, sigma: Float) -> tuple[float, float]:
    """Robust scale of error / sigma from the median, and from the 68 % quantile."""
    pull = np.abs(error / sigma)
    return float(MAD_TO_SIGMA * np.median(pull)), float(np.quantile(pull, ONE_SIGMA))


def one(series: Series, folder: Path, *, again: bool, num_threads: int) -> dict[str, Any]:
    """Render, reconstruct and judge a series, or read what was judged before."""
    home = folder / series.name
    result = home / "surface_sigma.npz"
    if not result.is_file() or again:
        rendered(home, series)
        config = replace(Config(), num_threads=num_threads)
        images = home / "series" / "images"
        run_stages(home / "project", config, names=STAGES, image_path=images)
        np.savez_compressed(result, allow_pickle=False, **judged(home / "project", home / "series"))
    with np.load(result) as data:
        return dict(data)


def row(name: str, d: dict[str, Any]) -> list[str]:
    """A line of the table of series."""
    error, sigma = d["error"], d["sigma"]
    median, p68 = scales(error, sigma)
    cloud, _ = scales(d["cloud_error"], d["cloud_sigma"])
    size = np.abs(error)
    low, high = np.quantile(sigma, [TENTH, 1.0 - TENTH])
    tenths = [
        f"{np.median(sigma[some]):.2f}, {MAD_TO_SIGMA * np.median(size[some]):.2f}"
        for some in (sigma >= high, sigma <= low)
    ]
    return [
        name,
        f"{len(error)}",
        f"{np.median(error):+.2f}",
        f"{np.median(size):.2f}",
        f"{np.quantile(size, 0.95):.2f}",
        f"{np.median(sigma):.2f}",
        *tenths,
        f"{median:.2f}",
        f"{p68:.2f}",
        f"{cloud:.2f}",
    ]


def octaves(found: Sequence[dict[str, Any]]) -> str:
    """The table by octave of sigma, every series with the same weight."""
    error = np.concatenate([d["error"] for d in found])
    sigma = np.concatenate([d["sigma"] for d in found])
    weight = np.concatenate([np.full(len(d["error"]), 1.0 / len(d["error"])) for d in found])
    octave = np.floor(np.log2(sigma)).astype(int)
    rows = []
    for k in np.unique(octave):
        inside = octave == k
        share = weight[inside].sum() / weight.sum()
        if share < LEAST_SHARE:
            continue
        pull = np.abs(error[inside] / sigma[inside])
        order = np.argsort(pull)
        below = np.cumsum(weight[inside][order]) / weight[inside].sum()
        median, p68 = (float(pull[order][np.searchsorted(below, q)]) for q in (0.5, ONE_SIGMA))
        cells = (f"{2.0**k:g} to {2.0 ** (k + 1):g}", f"{100 * share:.1f} %")
        rows.append([*cells, f"{MAD_TO_SIGMA * median:.2f}", f"{p68:.2f}"])
    return table(("sigma px", "share", "scale of error / sigma", "68 %"), rows)


def tables(found: dict[str, dict[str, Any]]) -> str:
    """Both tables, for the series that constants were fitted to and for the others."""
    text = []
    for title, chosen in (("Held out", False), ("Fitted to", True)):
        some = {name: d for name, d in found.items() if (name in CHOSEN) == chosen}
        if some:
            text += [f"{title}:", table(HEAD, [row(name, d) for name, d in some.items()])]
            together = [np.mean([scales(d["error"], d["sigma"])[k] for d in some.values()])
                        for k in (0, 1)]  # fmt: skip
            mean, p68 = together
            text += [f"Mean of the series' scales: {mean:.2f}; 68 %: {p68:.2f}. By octave:"]
            text.append(octaves(list(some.values())))
    return "\n\n".join(text)


def main() -> None:
    """Measure and print; with --markdown put the tables into a page."""
    p = parser(COMMAND, __doc__)
    p.add_argument("--folder", type=Path, required=True, help="where series and projects lie")
    p.add_argument("--set", choices=("train", "test"), default="test")
    p.add_argument("--names", nargs="*", help="these series alone")
    p.add_argument("--again", action="store_true", help="also what was judged before")
    p.add_argument("--stored", action="store_true", help="only what lies in the folder already")
    p.add_argument("--num_threads", type=int, default=-1)
    add_page_option(p, COMMAND)
    args = p.parse_args()
    if args.stored:
        found = {}
        for path in sorted(args.folder.glob("*/surface_sigma.npz")):
            with np.load(path) as data:
                found[path.parent.name] = dict(data)
    else:
        found = {}
        for series in TRAIN if args.set == "train" else TEST:
            if args.names and series.name not in args.names:
                continue
            try:
                found[series.name] = one(
                    series, args.folder, again=args.again, num_threads=args.num_threads
                )
            except InputError as error:
                print(f"{series.name}: {error}", flush=True)
                continue
            print(json.dumps(row(series.name, found[series.name])), flush=True)
    text = tables(found)
    print(text)
    if args.markdown is not None:
        put(args.markdown, COMMAND, text)


if __name__ == "__main__":
    main()
