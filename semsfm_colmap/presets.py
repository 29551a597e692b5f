"""What `--quality` sets: options of several stages that trade time for detail.

As COLMAP's automatic reconstructor has it, in four steps. `high` is the defaults of the options
themselves. docs/quality.md has times and errors of each.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, get_args

Quality = Literal["low", "medium", "high", "extreme"]
QUALITIES: tuple[Quality, ...] = get_args(Quality)
DEFAULT: Quality = "high"

PRESETS: Mapping[Quality, Mapping[str, Mapping[str, Any]]] = {
    "low": {
        "features": {"max_num_features": 4096, "first_octave": 0},
        "guided": {"rounds": 2, "fill_up_to": 0},
        "surface": {
            "max_depth_map_size_px": 400,
            "max_num_depth_maps": 12,
            "num_neighbors": 4,
            "max_texture_faces": 10_000,
            "max_texture_size_px": 1024,
        },
    },
    "medium": {
        "features": {"max_num_features": 4096},
        "guided": {"rounds": 3, "fill_up_to": 4000},
        "surface": {
            "max_depth_map_size_px": 768,
            "max_num_depth_maps": 24,
            "max_texture_size_px": 2048,
        },
    },
    "high": {},
    "extreme": {
        "features": {"max_num_features": 16_384},
        "matching": {"overlap": 10},
        "guided": {"rounds": 8, "converged_deg": 0.005, "fill_up_to": 20_000},
        "surface": {
            "max_depth_map_size_px": 2048,
            "max_num_depth_maps": 96,
            "num_neighbors": 8,
            "num_refinements": 3,
            "spacing_px": 1.5,
        },
    },
}
"""Section, option and value of each; what is not named has its default."""
