"""Areal parameters of rendered fields against those of their truth, at the same filtering.

Every field is rendered, mapped, densified and meshed without options but the hand, which is that
of the truth: upside down there is nothing to compare. Mesh and truth, brought together by the
cameras alone, become height maps on one grid; cells that both have count. Given are deviations of
the parameters, pulls (deviation over the standard uncertainty stated), the nesting index T of the
filter that takes the truth to the mesh, and how the deviations depend on the S-nesting index.
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
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.geometry.alignment import align_cameras_both_hands
from semsfm_colmap.io.ply import read_ply_mesh
from semsfm_colmap.metrology.heights.areal import areal_parameters
from semsfm_colmap.metrology.heights.characteristics import characteristics
from semsfm_colmap.metrology.heights.height_map import height_map_of_mesh, on_grid
from semsfm_colmap.metrology.heights.parameter_uncertainty import ErrorModel, measured_parameters
from semsfm_colmap.metrology.heights.scale_limited import Filtering, Transfer, scale_limited
from semsfm_colmap.pipeline.height_map import amplification_sigma, transfer_of
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.types import TriangleMesh

COMMAND = "metrology_areal"
STAGES = ("ingest", "extract", "match", "map")
SURFACE_STAGES = ("densify", "mesh")
MIN_IMAGES = 9
"""Fields of fewer images have depths of several px."""
RATIOS = (1.2, 1.5, 2.0, 3.0, 4.0)
"""S-nesting indices in units of T"""
NUM_DRAWS = 40
SHOWN = ("Sq", "Sa", "Sz", "Sku", "Sdq", "Sdr", "Sk", "Spk", "Svk", "Sal")
ABSOLUTE = ("Ssk",)
"""Parameters near 0, whose deviation is not relative"""
LARGE_FIELD = "synth_nickel"
FITTED = ("field_107_13x60_usual", "field_116_21x80_strong", LARGE_FIELD)
"""Fields that T and the share of sigma were chosen on."""
COVERAGE = 1.96


def of_right_hand(home: Path) -> bool:
    """Whether the model of a project has the hand of its truth."""
    model, truth = Project(home / "project").read_main_model(), load_truth(home / "series")
    number = {Path(name).stem: i for i, name in enumerate(truth.names)}
    true = truth.cameras.select(np.array([number[Path(n).stem] for n in model.image_names]))
    right, wrong = align_cameras_both_hands(model.cameras, true)
    return right.rotation_rms_rad <= wrong.rotation_rms_rad


def reconstructed(home: Path, series: Series, num_threads: int) -> None:
    """The mesh of a series, of the right hand, where it is not there yet."""
    rendered(home, series)
    config = replace(Config(), num_threads=num_threads)
    run_stages(home / "project", config, names=STAGES, image_path=home / "series" / "images")
    if not of_right_hand(home):
        refinement = replace(config.refinement, depth_sign="reversed")
        config = replace(config, refinement=refinement)
        run_stages(home / "project", config, names=STAGES[-1:])
    run_stages(home / "project", config, names=SURFACE_STAGES)


def judged(home: Path) -> dict[str, Any]:
    """Parameters of a mesh and of its truth, in px of the images."""
    project, truth = Project(home / "project"), load_truth(home / "series")
    model = project.read_main_model()
    number = {Path(name).stem: i for i, name in enumerate(truth.names)}
    true = truth.cameras.select(np.array([number[Path(n).stem] for n in model.image_names]))
    T = align_cameras_both_hands(model.cameras, true)[0].true_from_estimated
    px = truth.scale_px_per_unit
    mesh = read_ply_mesh(project.mesh / "mesh.ply")
    assert mesh.vertex_sigma is not None
    assert truth.mesh is not None
    mine = replace(
        mesh, vertices=px * T.apply(mesh.vertices), vertex_sigma=px * T.scale * mesh.vertex_sigma
    )
    theirs = TriangleMesh(vertices=px * truth.mesh.vertices, faces=truth.mesh.faces)
    found = height_map_of_mesh(mine, "px")
    assert found.origin is not None
    assert found.axes is not None
    known = on_grid(theirs, "px", found.origin, found.axes, found.spacing, found.z.shape)
    both = found.measured & known.measured
    found, known = (m.with_heights(np.where(both, m.z, np.nan)) for m in (found, known))
    to_px = px * T.scale
    own = transfer_of(project, model)
    transfer = Transfer(nesting_index=to_px * own.nesting_index, sigma=to_px * own.sigma)
    errors = ErrorModel(transfer=transfer, amplification_sigma=amplification_sigma(project))
    filtering = Filtering(s_index=transfer.default_s_index)
    rng = np.random.default_rng(0)
    measured = measured_parameters(
        found, filtering, errors, areal_parameters, rng, num_draws=NUM_DRAWS
    )
    ladder = {}
    for ratio in RATIOS:
        step = Filtering(s_index=ratio * transfer.nesting_index)
        ladder[f"{ratio:g}"] = [
            areal_parameters(scale_limited(found, step, transfer)),
            areal_parameters(scale_limited(known, step)),
        ]
    said = characteristics(found, filtering, transfer, truth=known)
    return {
        "hole_share": 1.0 - float(both.mean()),
        "overhang_share": known.overhang_share,
        "sigma_px": float(np.nanmedian(found.sigma)) if found.sigma is not None else None,
        "measured": {n: [p.value, p.sigma] for n, p in measured.items()},
        "true": areal_parameters(scale_limited(known, filtering)),
        "ladder": ladder,
        "characteristics": {c.symbol: c.value for c in said},
    }


def deviation(name: str, value: float, true: float) -> float:
    """In percent, or as a difference for a parameter near 0."""
    return value - true if name in ABSOLUTE else 100.0 * (value / true - 1.0)


def by_series(found: dict[str, dict[str, Any]]) -> str:
    """Deviation of each parameter of each field."""
    head = ("field", "Sq px", *(f"{n} %" for n in SHOWN), *ABSOLUTE, "T px", "alpha_z")
    rows = []
    for name, d in found.items():
        cells = [f"{deviation(n, d['measured'][n][0], d['true'][n]):+.1f}" for n in SHOWN] + [
            f"{deviation(n, d['measured'][n][0], d['true'][n]):+.3f}" for n in ABSOLUTE
        ]
        known = d["characteristics"]
        mark = " (fitted to)" if name in FITTED else ""
        last = (f"{known['D_LIM']:.1f}", f"{known['alpha_z']:.4f}")
        rows.append([name + mark, f"{d['true']['Sq']:.2f}", *cells, *last])
    return table(head, rows)


def by_parameter(found: dict[str, dict[str, Any]]) -> str:
    """Pulls of each parameter over the fields that nothing was chosen on, and over all."""
    head = (
        "parameter", "stated u % (median)", "largest deviation %", "RMS pull, held out",
        "RMS pull, all", "within 95 %",
    )  # fmt: skip
    rows, every = [], []
    for name in next(iter(found.values()))["measured"]:
        pulls, held, stated, off = [], [], [], []
        for series, d in found.items():
            value, sigma = d["measured"][name]
            true = d["true"][name]
            if not np.isfinite(value) or not np.isfinite(true) or not sigma > 0.0:
                continue
            pulls.append((value - true) / sigma)
            stated.append(sigma if name in ABSOLUTE else 100.0 * sigma / abs(value))
            off.append(abs(deviation(name, value, true)))
            if series not in FITTED:
                held.append(pulls[-1])
        if not held or name == "Std":
            continue
        every += held
        unit = " (absolute)" if name in ABSOLUTE else ""
        digits = 3 if name in ABSOLUTE else 1
        sizes = (f"{np.median(stated):.{digits}f}", f"{max(off):.{digits}f}")
        inside = f"{sum(abs(p) <= COVERAGE for p in pulls)} of {len(pulls)}"
        rows.append([name + unit, *sizes, f"{rms(held):.2f}", f"{rms(pulls):.2f}", inside])
    share = 100.0 * np.mean(np.abs(every) <= COVERAGE)
    return (
        table(head, rows)
        + f"\n\nAll parameters of the held-out fields together: RMS pull {rms(every):.2f}, "
        f"{share:.0f} % within their 95 % intervals."
    )


def by_nesting_index(found: dict[str, dict[str, Any]]) -> str:
    """Largest deviation over the fields at each S-nesting index."""
    head = ("S-nesting index", *(f"{n} %" for n in SHOWN))
    rows = []
    for ratio in RATIOS:
        cells = []
        for name in SHOWN:
            off = [
                abs(deviation(name, *(pair[name] for pair in d["ladder"][f"{ratio:g}"])))
                for d in found.values()
            ]
            cells.append(f"{max(off):.1f}")
        rows.append([f"{ratio:g} T", *cells])
    return table(head, rows)


def rms(values: Sequence[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def tables(found: dict[str, dict[str, Any]]) -> str:
    """All three."""
    return "\n\n".join(
        [
            "Deviation from the truth at the default S-nesting index, 2 T:",
            by_series(found),
            "Uncertainties stated, and what they hold:",
            by_parameter(found),
            "Largest deviation over all fields, by S-nesting index:",
            by_nesting_index(found),
        ]
    )


def main() -> None:
    """Measure and print; with --markdown put the tables into a page."""
    p = parser(COMMAND, __doc__)
    p.add_argument("--folder", type=Path, required=True, help="where series and projects lie")
    p.add_argument("--again", action="store_true", help="also what was judged before")
    p.add_argument("--stored", action="store_true", help="only projects that lie there already")
    p.add_argument("--num_threads", type=int, default=-1)
    add_page_option(p, COMMAND)
    args = p.parse_args()
    names = []
    for series in (*TRAIN, *TEST):
        if series.row != "field" or (series.options.num_images or 0) < MIN_IMAGES:
            continue
        home = args.folder / series.name
        if not args.stored:
            reconstructed(home, series, args.num_threads)
        names.append(series.name)
    found = {}
    # the development data's own field is judged where its project lies beside
    for name in (*names, LARGE_FIELD):
        home = args.folder / name
        result = home / "metrology_areal.json"
        if not (home / "project" / "mesh" / "mesh.ply").is_file():
            continue
        if not result.is_file() or args.again:
            result.write_text(json.dumps(judged(home)))
        found[name] = json.loads(result.read_text())
        print(name, flush=True)
    text = tables(found)
    print(text)
    if args.markdown is not None:
        put(args.markdown, COMMAND, text)


if __name__ == "__main__":
    main()
