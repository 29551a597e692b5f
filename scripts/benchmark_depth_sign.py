"""How often is the hand right, and is the confidence honest? The source of the cues' weights.

usage: benchmark_depth_sign.py [--scenes 300] [--end-to-end 20] [--markdown FILE] [--rows FILE]
       [--project FOLDER[:TRUTH] ...]

Draws --scenes training scenes and as many test scenes of closed bodies, fields and bodies on a
substrate, turned by 10 to 360 degrees in 3 to 72 images (semsfm_colmap.synthetic.occluded_tracks),
with errors of cameras, points and matches at realistic levels, and models fitted to noise. On the
training scenes the factors between t statistics and log odds are fitted (printed beside the ones in
use, which are constants of semsfm_colmap.refinement.depth_reversal.visibility); the tables are of
the test scenes with the ones in use. --end-to-end takes tracks through factorization and
refinement. --project adds mapped projects, with their truth where there is one.

About half a second a scene. --rows keeps what was measured; a second run then only fits and prints.
"""

from __future__ import annotations

import argparse
import itertools
import json
import warnings
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.refinement.depth_reversal import (
    decide_depth_sign,
    known_tilt_cue,
    reverse_depth,
    visibility_cues,
)
from semsfm_colmap.refinement.depth_reversal import visibility as in_use
from semsfm_colmap.refinement.depth_reversal.cue import CONVEX_CUES, CONVEX_MAX_LOGIT, MAX_LOGIT
from semsfm_colmap.refinement.depth_reversal.decision import fused_logit
from semsfm_colmap.synthetic.light_shapes import Shape
from semsfm_colmap.synthetic.occluded_tracks import (
    OccludedScene,
    OccludedTracksOptions,
    noise_scene,
    simulate_occluded,
)

SHARES: dict[Shape, float] = {
    "bumpy": 0.205,
    "spiny": 0.17,
    "clump": 0.159,
    "field": 0.2,
    "crater": 0.1,
    "substrate": 0.16,
    "cup": 0.006,
}
"""One body in a hundred is a cup, a little fewer than CONVEX_MAX_LOGIT assumes; a table of their
own shows what becomes of them."""
KINDS = {
    "bumpy": "closed body",
    "spiny": "closed body",
    "clump": "closed body",
    "cup": "hollow body",
    "field": "field",
    "crater": "field",
    "substrate": "bodies on a substrate",
    "noise": "noise",
}
SIGMA_TILT_DEG = 0.5
MIN_CONFIDENCE = 0.95
TRAIN, TEST, HOLLOW, NOISE, THROUGH = 1, 11, 13, 14, 15
"""First number of the seed: which set a scene belongs to."""
BINS = (0.5, 0.8, 0.95, 0.99, 0.999, 1.0)


@dataclass(frozen=True, kw_only=True)
class Row:
    """One scene: what the cues said of the right hand."""

    shape: str
    range_deg: float
    num_images: int
    num_points: int
    t: dict[str, float] = field(default_factory=dict)
    logit: dict[str, float] = field(default_factory=dict)
    body: bool = False
    """whether the cues that need background around the specimen counted"""

    @property
    def kind(self) -> str:
        """What the tables call it."""
        return KINDS[self.shape]

    def total(self, with_tilt: bool) -> float:
        """Log odds of the right hand, bounded as `decide_depth_sign` bounds them."""
        return fused_logit(
            {name: x for name, x in self.logit.items() if with_tilt or name != "known tilt"}
        )


def draw_options(rng: np.random.Generator, shape: Shape | None = None) -> OccludedTracksOptions:
    """One scene of the mixture."""
    kind = shape or str(rng.choice(list(SHARES), p=list(SHARES.values())))
    widest = 80.0 if kind in ("field", "crater", "substrate") else 90.0 if kind == "cup" else 360.0
    range_deg = float(np.exp(rng.uniform(np.log(10.0), np.log(widest))))
    fewest = max(3, int(np.ceil(range_deg / 12.0)) + 1)
    most = int(np.clip(range_deg / 1.5, fewest, 72))
    return OccludedTracksOptions(
        shape=kind,  # type: ignore[arg-type]
        range_deg=range_deg,
        num_images=int(rng.integers(fewest, most + 1)),
        num_points=int(np.exp(rng.uniform(np.log(2000.0), np.log(12000.0)))),
        detection=float(rng.uniform(0.3, 0.8)),
        limit_deg=float(rng.uniform(60.0, 78.0)),
        ridge_preference=float(0.4 * rng.normal()),
        track_length_deg=float(rng.uniform(8.0, 35.0)),
        noise_px=float(rng.uniform(0.15, 0.6)),
        shading_px=float(1.5 * rng.normal()),
        wrong_share=float(rng.uniform(0.0, 0.04)),
        rotation_error_deg=float(np.exp(rng.normal(-2.3, 0.8))),
        tilt_error=float(0.02 * rng.normal()),
    )


def measure(scene: OccludedScene, shape: str, range_deg: float, rng: np.random.Generator) -> Row:
    """The cues of a scene, with a known tilt read to half a degree."""
    sigma = np.radians(SIGMA_TILT_DEG)
    cues = visibility_cues(scene.cameras, scene.points, scene.observations, scene.image_size_px)
    tilt = scene.true_angle_rad + sigma * rng.normal(size=len(scene.cameras))
    if shape == "noise":  # a tilt that has nothing to do with the cameras
        tilt = rng.permutation(tilt)
    if range_deg < 150.0:  # stages tilt, they do not turn a specimen over
        cues["known tilt"] = known_tilt_cue(scene.cameras, tilt, scene.axis, float(sigma))
    near = cues["near side"]
    return Row(
        shape=shape,
        range_deg=range_deg,
        num_images=len(scene.cameras),
        num_points=len(scene.points),
        t={name: cue.t for name, cue in cues.items()},
        logit={name: cue.logit for name, cue in cues.items()},
        body=near.t != 0.0 and near.probability != 0.5,
    )


def simulate(group: int, k: int, shape: Shape | None = None) -> Row:
    """Scene k of a group."""
    rng = np.random.default_rng([group, k])
    options = draw_options(rng, shape)
    return measure(simulate_occluded(options, rng), options.shape, options.range_deg, rng)


def simulate_noise(k: int) -> Row:
    """Model k of noise."""
    rng = np.random.default_rng([NOISE, k])
    scene = noise_scene(int(rng.integers(3, 73)), int(rng.integers(300, 6000)), rng)
    return measure(scene, "noise", float(np.degrees(np.ptp(scene.true_angle_rad))), rng)


def through_the_pipeline(k: int) -> Row:
    """Scene k from its raw tracks through factorization, refinement and the decision."""
    from semsfm_colmap.factorization.options import FactorizationOptions
    from semsfm_colmap.geometry.alignment import align_cameras
    from semsfm_colmap.mapping.parts import map_observations
    from semsfm_colmap.refinement.options import RefinementOptions

    rng = np.random.default_rng([THROUGH, k])
    options = draw_options(rng)
    scene = simulate_occluded(options, rng)
    names = tuple(f"{i:03d}.png" for i in range(options.num_images))
    solved = map_observations(
        scene.raw,
        names,
        scene.image_size_px,
        factorization=FactorizationOptions(),
        refinement=RefinementOptions(),
    )
    if solved.value is None:
        return Row(shape=options.shape, range_deg=options.range_deg, num_images=0, num_points=0)
    model = solved.value[0].reconstruction
    true = scene.true_cameras.select([int(n[:3]) for n in model.image_names])
    as_it_is = align_cameras(model.cameras, true)
    twin = align_cameras(model.cameras, true, reverse_depth=True)
    right = error_of(as_it_is) <= error_of(twin)
    sign = model.depth_sign
    total = float(np.log(sign.confidence) - np.log1p(-sign.confidence))
    return Row(
        shape=options.shape,
        range_deg=options.range_deg,
        num_images=model.num_images,
        num_points=len(model.points),
        logit={"all": total if right else -total},
    )


def error_of(alignment: Any) -> float:
    """Median rotation error of an alignment, rad."""
    return float(np.median(alignment.rotation_error_rad))


def fit(rows: list[Row]) -> dict[str, float]:
    """Log odds per t of each cue by maximum likelihood.

    Those that take the body to be convex are bounded together, as in use. A prior of one scene in
    which each cue was wrong at t = 4 keeps the factors finite where no
    training scene contradicts a cue.
    """
    from scipy.optimize import minimize

    names = list(in_use.CUES)
    t = np.array([[r.t.get(name, 0.0) for name in names] for r in rows]).reshape(-1, len(names))
    convex = np.array([name in CONVEX_CUES for name in names])
    counts = np.where(convex, np.array([r.body for r in rows], dtype=bool)[:, None], True)

    def cost(w: Any) -> float:
        logit = np.where(counts, np.clip(w * t, -MAX_LOGIT, MAX_LOGIT), 0.0)
        total = np.clip(logit[:, convex].sum(axis=1), -CONVEX_MAX_LOGIT, CONVEX_MAX_LOGIT)
        total += logit[:, ~convex].sum(axis=1)
        prior = np.logaddexp(0.0, 4.0 * np.asarray(w)).sum()
        return float(np.logaddexp(0.0, -total).sum() + prior)

    best = minimize(
        cost,
        [0.5] * len(names),
        method="Nelder-Mead",
        bounds=[(0.0, 3.0)] * len(names),
        options={"maxiter": 2000},
    )
    return dict(zip(names, best.x.tolist(), strict=True))


def reliability(rows: list[Row], with_tilt: bool) -> str:
    """Of the scenes with a confidence within each bin, how many have the right hand."""
    total = np.array([r.total(with_tilt) for r in rows])
    confidence = 1.0 / (1.0 + np.exp(-np.abs(total)))
    lines = [
        "| confidence | scenes | mean confidence | right | share right | chance of so few |",
        "|---|---|---|---|---|---|",
    ]
    for low, high in itertools.pairwise(BINS):
        inside = (confidence >= low) & (confidence < high) & (total != 0.0)
        n, right = int(inside.sum()), int((total[inside] > 0).sum())
        said = f"{confidence[inside].mean():.4f}" if n else "-"
        share = f"{right / n:.3f}" if n else "-"
        chance = f"{chance_of_at_most(right, confidence[inside]):.2f}" if n else "-"
        lines.append(f"| {low} to {high} | {n} | {said} | {right} | {share} | {chance} |")
    lines.append(f"| no evidence | {int((total == 0).sum())} | 0.5 | - | - | - |")
    return "\n".join(lines)


def chance_of_at_most(right: int, probability: Any) -> float:
    """Chance of at most so many right ones if each is right with the probability it claims.

    Near zero the confidence claims too much; the exact distribution of a sum of unlike coins.
    """
    distribution = np.ones(1)
    for p in probability:
        distribution = np.convolve(distribution, [1.0 - p, p])
    return float(distribution[: right + 1].sum())


def by_kind(rows: list[Row], with_tilt: bool) -> str:
    """Resolved right, resolved wrong, ambiguous: by kind and range."""
    bound = np.log(MIN_CONFIDENCE / (1.0 - MIN_CONFIDENCE))
    lines = [
        "| specimen | range | scenes | resolved, right | ambiguous | resolved, wrong |",
        "|---|---|---|---|---|---|",
    ]
    for kind in dict.fromkeys(KINDS.values()):
        for low, high in ((10, 30), (30, 90), (90, 361)):
            total = np.array(
                [r.total(with_tilt) for r in rows if r.kind == kind and low <= r.range_deg < high]
            )
            if len(total) == 0:
                continue
            right, wrong = int((total >= bound).sum()), int((total <= -bound).sum())
            label = f"{low} to {min(high, 360)}°"
            open_ = len(total) - right - wrong
            lines.append(f"| {kind} | {label} | {len(total)} | {right} | {open_} | {wrong} |")
    return "\n".join(lines)


def project_row(text: str) -> str:
    """One mapped project, as a line of a table."""
    from semsfm_colmap.colmap.model.sparse import read_model
    from semsfm_colmap.evaluation.truth import load_truth
    from semsfm_colmap.geometry.alignment import align_cameras

    folder, _, truth_folder = text.partition(":")
    model = read_model(Path(folder) / "sparse" / "0")
    cameras, points = model.cameras, np.asarray(model.points)
    hand = "not known"
    reversed_ = False
    if truth_folder:
        truth = load_truth(Path(truth_folder))
        number = {Path(name).stem: k for k, name in enumerate(truth.names)}
        true = truth.cameras.select([number[Path(name).stem] for name in model.image_names])
        reversed_ = error_of(align_cameras(cameras, true, reverse_depth=True)) < error_of(
            align_cameras(cameras, true)
        )
    cues = visibility_cues(
        cameras, points, model.observations.select(model.inlier), model.image_size_px
    )
    sign, reverse = decide_depth_sign(cues, MIN_CONFIDENCE)
    if truth_folder:
        hand = "right" if reverse == reversed_ else "wrong"
    twin = reverse_depth(cameras, points)
    other = visibility_cues(*twin, model.observations.select(model.inlier), model.image_size_px)
    assert all(np.isclose(other[k].t, -cues[k].t, atol=1e-6) for k in cues)
    flip = -1.0 if reverse else 1.0
    numbers = " | ".join(f"{flip * cue.t:.1f}" for cue in cues.values())
    return (
        f"| {Path(folder).name} | {model.num_images} | {len(points)} | {numbers} | {sign.status} | "
        f"{sign.confidence:.4f} | {hand} |"
    )


def collect(args: argparse.Namespace) -> dict[str, list[Row]]:
    """Measure the scenes, or read those that were measured before."""
    path = Path(args.rows) if args.rows else None
    stored = json.loads(path.read_text()) if path and path.is_file() else {}
    groups: dict[str, tuple[int, Callable[[int], Row]]] = {
        "train": (args.scenes, lambda k: simulate(TRAIN, k)),
        "test": (args.scenes, lambda k: simulate(TEST, k)),
        "hollow": (args.scenes // 8, lambda k: simulate(HOLLOW, k, "cup")),
        "noise": (args.scenes // 3, simulate_noise),
        "through": (args.end_to_end, through_the_pipeline),
    }
    rows: dict[str, list[Row]] = {}
    for name, (count, one) in groups.items():
        rows[name] = [Row(**row) for row in stored.get(name, [])][:count]
        for k in range(len(rows[name]), count):
            rows[name].append(one(k))
            if (k + 1) % 50 == 0 or name == "through":
                print(f"{name}: {k + 1} of {count}", flush=True)
        if path:  # group by group, so that a run that is stopped keeps what it has
            done = {n: [asdict(r) for r in some] for n, some in rows.items()}
            path.write_text(json.dumps(stored | done))
    return rows


def report(rows: dict[str, list[Row]], projects: Iterable[str]) -> str:
    """The tables, in Markdown."""
    fitted = fit(rows["train"])
    used = {name: factor for name, (factor, _) in in_use.CUES.items()}
    n = len(rows["test"])
    parts = [
        "### Factors from t to log odds\n\n| cue | fitted on the training scenes | in use |\n"
        "|---|---|---|\n"
        + "\n".join(f"| {name} | {fitted[name]:.2f} | {used[name]:.2f} |" for name in used),
        f"### Reliability, {n} test scenes, visibility alone\n\n"
        + reliability(rows["test"], False),
        f"### Reliability, the same with a known tilt (turns below 150°, read to "
        f"{SIGMA_TILT_DEG}°)\n\n" + reliability(rows["test"], True),
        "### What becomes of each kind, visibility alone\n\n" + by_kind(rows["test"], False),
        "### What becomes of each kind, with a known tilt\n\n" + by_kind(rows["test"], True),
        f"### {len(rows['hollow'])} more hollow bodies, visibility alone\n\n"
        + by_kind(rows["hollow"], False)
        + "\n\n"
        + reliability(rows["hollow"], False),
        f"### {len(rows['noise'])} models fitted to noise\n\n"
        + by_kind(rows["noise"], False)
        + "\n\nWith a tilt that has nothing to do with them:\n\n"
        + by_kind(rows["noise"], True),
    ]
    if rows["through"]:
        mapped = [r for r in rows["through"] if r.logit]
        parts.append(
            f"### {len(mapped)} of {len(rows['through'])} sets of tracks taken through "
            "factorization and refinement\n\n"
            + by_kind(mapped, False)
            + "\n\n"
            + reliability(mapped, False)
        )
    lines = [project_row(text) for text in projects]
    if lines:
        parts.append(
            "### Series\n\nt statistics, positive for the hand that was chosen.\n\n"
            f"| series | images | points | {' | '.join(in_use.CUES)} | status | confidence | hand |"
            f"\n|---|---|---|{'---|' * len(in_use.CUES)}---|---|---|\n" + "\n".join(lines)
        )
    return "\n\n".join(parts) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--end-to-end", type=int, default=20)
    parser.add_argument("--markdown")
    parser.add_argument("--rows", help="where to keep the measurements")
    parser.add_argument("--project", nargs="*", default=[], help="FOLDER[:TRUTH]")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    text = report(collect(args), args.project)
    print(text)
    if args.markdown:
        path = Path(args.markdown)
        mark = "<!-- tables: scripts/benchmark_depth_sign.py -->\n"
        head = path.read_text().partition(mark)[0] if path.is_file() else ""
        path.write_text(head + mark + "\n" + text)


if __name__ == "__main__":
    main()
