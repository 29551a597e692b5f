"""The forward model of a dual-chirality helical nanobelt: rotation in proportion to displacement.

Two helices of opposite chirality, pulled at both ends, turn what is between them without carrying
it along [Kratochvil et al. 2010]:

    angle = f (displacement - displacement_0).

The paper's belts have f = 171.3 deg per um. Another belt has another factor: this one only proposes
image pairs, and tells a table in nanometres from one in micrometres; the images say what f is.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float

START_DEG_PER_UM = 171.3
"""[Kratochvil et al. 2010]"""
PLAUSIBLE = 100.0
"""A factor this many times larger or smaller speaks of another unit: units differ by 1000."""


def predicted_angles(displacement_um: Float) -> Float:
    """Angles (M,) in rad, of the paper's belt, from the smallest displacement."""
    return np.asarray(np.deg2rad(START_DEG_PER_UM) * (displacement_um - np.min(displacement_um)))


def unit_doubt(deg_per_um: float) -> str:
    """A sentence where the factor is that of no belt; empty otherwise."""
    ratio = abs(deg_per_um) / START_DEG_PER_UM
    if ratio <= 0.0 or 1.0 / PLAUSIBLE <= ratio <= PLAUSIBLE:
        return ""
    unit = "nanometres" if ratio < 1.0 else "millimetres"
    return (
        f"the displacements give {abs(deg_per_um):.3g} degrees per um where helical nanobelts "
        f"turn by some {START_DEG_PER_UM:.0f}: displacement_um seems to hold {unit}"
    )
