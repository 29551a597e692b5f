"""Simulated series seen from a finite distance: rotations with parallel projection and without.

Noise 0.3 px, 3 % wrong matches, points on a bumpy sphere, three seeds a row. Errors are root mean
squares over all images of the rotations that are left after a common one of the world, with the
standard deviations stated for them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks import tables
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.alignment import align_rotations
from semsfm_colmap.geometry.rotations import depth_reversed, rotation_angle
from semsfm_colmap.mapping.finish import MappedPart
from semsfm_colmap.mapping.parts import map_observations
from semsfm_colmap.refinement.model_choice import total_rotation
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.synthetic.tracks import SimulatedTracks, seen_in_perspective, simulate_tracks
from semsfm_colmap.types import Float

RADIUS_PX, SIZE_PX = 400.0, 1000
SEEDS = (1, 2, 3)
CASES: tuple[tuple[str, int, float, int, float], ...] = (
    ("full turn", 36, 350.0, 9, 0.08),
    ("full turn", 36, 350.0, 9, -0.08),
    ("full turn", 36, 350.0, 9, 0.02),
    ("120 degrees", 16, 120.0, 0, 0.08),
    ("60 degrees", 13, 60.0, 0, 0.08),
    ("60 degrees", 13, 60.0, 0, 0.01),
    ("60 degrees", 13, 60.0, 0, 0.0),
    ("20 degrees", 7, 20.0, 0, 0.03),
)
"""Name, images, range, longest track (0: any), radius over distance."""
HEAD = (
    "series",
    "images",
    "radius / distance",
    "taken out",
    "found",
    "parallel: rotations deg (sigma)",
    "perspective: rotations deg (sigma)",
    "parallel: total rotation deg (sigma)",
    "perspective: total rotation deg (sigma)",
)


def simulated(num_images: int, range_deg: float, window: int, share: float, seed: int) -> Any:
    """Tracks of one row and seed."""
    tracks = simulate_tracks(
        num_images=num_images,
        range_deg=range_deg,
        num_tracks=1200,
        track_window=window,
        outlier_share=0.03,
        radius_px=RADIUS_PX,
        rng=np.random.default_rng(seed),
    )
    return seen_in_perspective(tracks, share / RADIUS_PX, SIZE_PX / 2)


def mapped(series: SimulatedTracks, *, perspective: bool) -> MappedPart | None:
    """The largest part."""
    M = len(series.cameras)
    found = map_observations(
        series.observations,
        tuple(f"{i:03}" for i in range(M)),
        np.full((M, 2), SIZE_PX),
        factorization=FactorizationOptions(),
        refinement=RefinementOptions(perspective="auto" if perspective else "off"),
    ).value
    return None if found is None else found[0]


def errors(part: MappedPart, series: SimulatedTracks) -> tuple[Float, Float, float, float]:
    """Rotation errors and sigmas, error and sigma of the total rotation, deg."""
    r = part.reconstruction
    true = np.asarray(series.cameras.cam_from_world)[[int(name) for name in r.image_names]]
    R = np.asarray(r.cameras.cam_from_world)
    left = [
        rotation_angle(Q @ align_rotations(Q, true) @ true.transpose(0, 2, 1))
        for Q in (R, depth_reversed(R))
    ]
    sigma = np.full(len(R), np.nan)
    if r.sigma_rotation_rad is not None:
        sigma = np.sqrt(np.sum(np.asarray(r.sigma_rotation_rad) ** 2, axis=1))
    trust = part.figures.reliability
    total = trust.total_rotation_deg - float(np.rad2deg(total_rotation(true)))
    best = min(left, key=lambda angle: float(np.median(angle)))
    return np.rad2deg(best), np.rad2deg(sigma), total, trust.total_rotation_sigma_deg


def rms(values: Any) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def row(name: str, num_images: int, range_deg: float, window: int, share: float) -> list[Any]:
    """One row of the table."""
    cells: dict[bool, str] = {}
    totals: dict[bool, str] = {}
    used, found = 0, []
    for perspective in (False, True):
        rows = []
        for seed in SEEDS:
            series = simulated(num_images, range_deg, window, share, seed)
            part = mapped(series, perspective=perspective)
            if part is None:
                continue
            rows.append(errors(part, series))
            figures = part.figures.reliability.perspective
            if perspective and figures is not None:
                used += figures.used
                found.append(figures.kappa_per_px * RADIUS_PX)
        left, sigma, total, total_sigma = zip(*rows, strict=True)
        angles, bars = rms(np.concatenate(left)), rms(np.concatenate(sigma))
        cells[perspective] = f"{angles:.3f} ({bars:.3f})"
        totals[perspective] = f"{rms(total):.3f} ({rms(total_sigma):.3f})"
    shown = ", ".join(f"{value:+.4f}" for value in found) or "none"
    return [
        name,
        num_images,
        f"{share:+.2f}" if share else "0",
        f"{used} of {len(SEEDS)}",
        shown,
        cells[False],
        cells[True],
        totals[False],
        totals[True],
    ]


def main() -> None:
    """Measure and print."""
    parser = tables.parser("perspective", __doc__)
    tables.add_page_option(parser, "perspective")
    arguments = parser.parse_args()
    rows = []
    for case in CASES:
        rows.append(row(*case))
        print(tables.line(rows[-1]), flush=True)
    if arguments.markdown is not None:
        tables.put(arguments.markdown, "perspective", tables.table(HEAD, rows))


if __name__ == "__main__":
    main()
