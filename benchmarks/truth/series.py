"""The rendered series: a training set, on which constants are chosen, and a test set."""

from __future__ import annotations

from dataclasses import dataclass, replace

from semsfm_colmap.synthetic.options import SynthesizeOptions

BASE = SynthesizeOptions(width_px=420, height_px=360, databar_rows=30, image_format="tif")
SHADING = {
    "usual": {},
    "weak": {"secant_exponent": 0.6, "detector_strength": 0.2},
    "strong": {"secant_exponent": 1.2, "detector_strength": 0.8},
    "albedo": {"albedo_contrast": 0.35},
    "none": {
        "secant_exponent": 0.0,
        "detector_strength": 0.0,
        "edge_strength": 0.0,
        "thin_strength": 0.0,
        "cavity_strength": 0.0,
    },
}


@dataclass(frozen=True, kw_only=True)
class Series:
    """One rendered series and the row of the table that it belongs to."""

    name: str
    row: str
    options: SynthesizeOptions


def series(
    row: str, scene: str, seed: int, num_images: int, range_deg: float, shading: str = "usual"
) -> Series:
    """A series of the small base size."""
    options = replace(
        BASE,
        scene=scene,  # type: ignore[arg-type]
        seed=seed,
        num_images=num_images,
        range_deg=range_deg,
        **SHADING[shading],  # type: ignore[arg-type]
    )
    name = f"{scene}_{seed}_{num_images}x{range_deg:g}_{shading}"
    return Series(name=name, row=row, options=options)


TRAIN = (
    series("grain", "grain", 104, 24, 115, "strong"),
    series("grain", "grain", 101, 24, 115),
    series("grain", "grain", 103, 36, 175),
    series("grain", "grain", 110, 24, 115, "albedo"),
    series("grain", "grain", 113, 24, 115, "none"),
    series("grain", "grain", 111, 18, 85, "weak"),
    series("turn", "grain", 115, 48, 352),
    series("turn", "clump", 106, 40, 351),
    series("clump", "clump", 105, 24, 115),
    series("clump", "clump", 114, 12, 45, "strong"),
    series("small", "grain", 102, 12, 60),
    series("small", "grain", 109, 6, 25),
    series("field", "field", 107, 13, 60),
    series("field", "field", 108, 7, 20),
    series("field", "field", 112, 5, 10),
    series("field", "field", 116, 21, 80, "strong"),
)
"""The constants of `refinement.drag` and `refinement.uncertainty` were chosen on these."""

_KINDS = ("usual", "strong", "albedo", "weak", "usual", "none", "strong", "usual", "weak", "usual")
TEST = (
    *(
        series("grain", "grain", 201 + k, (24, 30, 18, 40, 24)[k % 5], (115, 150, 80, 178, 100)[k % 5],
               _KINDS[k])
        for k in range(10)
    ),
    *(
        series("clump and turn", ("clump", "grain")[k % 2], 221 + k, (24, 48, 16, 60, 36)[k % 5],
               (115, 352, 60, 354, 170)[k % 5], _KINDS[k])
        for k in range(10)
    ),
    *(
        series("small", ("grain", "clump")[k % 2], 241 + k, (5, 8, 6, 12, 7)[k % 5],
               (20, 40, 12, 60, 30)[k % 5], _KINDS[k])
        for k in range(10)
    ),
    *(
        series("field", "field", 261 + k, (13, 21, 5, 7, 9)[k % 5], (60, 80, 10, 20, 40)[k % 5],
               _KINDS[k])
        for k in range(10)
    ),
)  # fmt: skip
"""Four rows of ten that nothing was chosen on."""
