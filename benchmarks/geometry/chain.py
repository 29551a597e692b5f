"""Fine steps and short tracks: in one piece and in segments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.geometry.errors import aligned, cramer_rao, errors
from benchmarks.geometry.long_series import long_series
from benchmarks.tables import table
from semsfm_colmap.factorization.factorize import factorize, factorize_whole, find_parts
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine

CHAINS = ((250, 15_000, 8), (500, 30_000, 8), (1000, 60_000, 8))
"""Frames, tracks, consecutive frames of a track."""
NOTE = (
    "A closed turn, each track in 8 consecutive frames. RMS rotation error in degrees of the "
    "start of the bundle adjustment, factorized in one piece and in overlapping segments, with "
    "the gap of eigenvalues in brackets; after refinement; and its Cramer-Rao bound."
)
HEAD = [
    "frames",
    "tracks",
    "track deg",
    "track lengths a turn",
    "one piece deg (gap)",
    "segments deg (gap)",
    "segments",
    "refined deg",
    "bound deg",
]


def make(data: Path, quick: bool) -> str:
    """The table of three lengths of a chain."""
    rows = []
    for frames, tracks, length in CHAINS[:1] if quick else CHAINS:
        s = long_series(frames, tracks, length, span_deg=0.0)
        obs, options = s.observations, FactorizationOptions()
        part = find_parts(obs, options)[0]
        true = s.cameras.select(part.images)
        cells: list[Any] = []
        start: Any = None
        for function in (factorize_whole, factorize):
            start = function(part, obs, options, np.random.default_rng(0))
            assert start.value is not None, start.message
            R, _, _ = aligned(start.value.cameras, start.value.points, true)
            angle = rotation_angle(R @ np.asarray(true.cam_from_world).mT)
            rms_deg = np.rad2deg(np.sqrt(np.mean(angle**2)))
            cells.append(f"{rms_deg:.2f} ({start.value.figures.eigenvalue_gap:.2f})")
        fit = refine(
            start.value.cameras,
            part.images,
            obs,
            RefinementOptions(),
            rng=np.random.default_rng(0),
        ).value
        assert fit is not None
        bound = cramer_rao(s, False)
        least = np.sqrt(np.mean(np.sum(bound.sigma_rotation_rad**2, axis=1)))
        rows.append(
            [
                frames,
                f"{tracks:,}",
                f"{360.0 * length / frames:.1f}",
                f"{frames / length:.0f}",
                *cells,
                start.value.figures.num_segments or 1,
                f"{errors(fit, s)[0]:.2f}",
                f"{np.rad2deg(least):.2f}",
            ]
        )
        print(rows[-1], flush=True)
    return f"{NOTE}\n\n{table(HEAD, rows)}"
