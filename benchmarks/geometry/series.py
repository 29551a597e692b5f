"""Simulated series, and the program's way from their tracks to refined cameras."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from semsfm_colmap.factorization.factorize import factorize_most, find_parts
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import Refined, refine
from semsfm_colmap.synthetic.tracks import SimulatedTracks, simulate_tracks
from semsfm_colmap.tracks.split import split_tracks


class Series(NamedTuple):
    """What a row of a table simulates."""

    frames: int
    range_deg: float
    tracks: int
    body: str
    window: int
    """Longest track, in frames; 0 for no limit"""

    @property
    def label(self) -> str:
        """Its first column."""
        return f"{self.frames} / {self.range_deg:g} deg"


SERIES = (
    Series(60, 180.0, 2000, "body", 10),
    Series(7, 30.0, 600, "field", 0),
    Series(5, 12.0, 600, "field", 0),
    Series(3, 10.0, 600, "field", 0),
)
SHARES = (0.0, 0.1, 0.2, 0.3)
"""Of wrong observations or matches."""
NOISE_PX = 0.3


def simulate(series: Series, known_scale: bool, seed: int, **options: Any) -> SimulatedTracks:
    """One series; the magnifications all equal, or as unlike as the program's prior has them."""
    return simulate_tracks(
        num_images=series.frames,
        range_deg=series.range_deg,
        num_tracks=series.tracks,
        body=series.body,
        track_window=series.window,
        noise_px=NOISE_PX,
        scale_drift=0.0 if known_scale else RefinementOptions().scale_sigma,
        rng=np.random.default_rng(seed),
        **options,
    )


def solve(s: SimulatedTracks, known_scale: bool) -> Refined:
    """The whole mapping of the program, from tracks to refined cameras."""
    rng = np.random.default_rng(0)
    factorization = FactorizationOptions()
    part = find_parts(s.observations, factorization)[0]
    tied, start = factorize_most(part, s.observations, factorization, rng)
    assert start.value is not None, start.message
    options = RefinementOptions(
        camera_model="orthographic" if known_scale else "scaled_orthographic"
    )
    seen = split_tracks(
        s.observations,
        start.value.cameras,
        tied.images,
        min_length=options.min_track_length,
        trials=options.ransac_trials,
    )
    fit = refine(start.value.cameras, tied.images, seen, options, rng=rng)
    assert fit.value is not None, fit.message
    return fit.value
