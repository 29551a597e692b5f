"""Lengths and roughness of a reconstructed surface, each with its uncertainty.

    python examples/measure_and_roughness.py PROJECT IMAGE:X1,Y1 IMAGE:X2,Y2 [X0 Y0 X1 Y1]

Two places, picked in images, are a distance; the rectangle of the first image, if one is given, is
the part of the surface that becomes a height map. A whole grain has none: it overhangs.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import semsfm_colmap as semsfm


def main(
    project_path: Path,
    places: Sequence[str],
    rectangle: tuple[float, float, float, float] | None = None,
) -> None:
    """Print a length with its budget, and areal parameters with their uncertainties."""
    for found in semsfm.measure(project_path, points=places):
        low, high = found.interval
        print(f"{found.name}: {found.value:.4g} {found.unit}, 95 %: {low:.4g} to {high:.4g}")
        for source in found.sources:
            print(f"  {100 * found.share(source):5.1f} %  {source.name} (kind {source.kind})")

    areal = semsfm.height_map(project_path, region=rectangle)
    for name in ("Sq", "Sa", "Sz", "Sdr"):
        one = areal["parameters"][name]
        print(f"{name}: {one['value']:.4g} +- {one['standard_uncertainty']:.2g} {one['unit']}")


if __name__ == "__main__":
    numbers = tuple(float(v) for v in sys.argv[4:8])
    main(Path(sys.argv[1]), sys.argv[2:4], numbers if len(numbers) == 4 else None)
