"""The rendered series: a training set, on which constants are chosen, a test set, larger ones."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from semsfm_colmap.synthetic.options import SynthesizeOptions, example_options

BASE = SynthesizeOptions(width_px=420, height_px=360, databar_rows=30, image_format="tif")
SHADING = {
    "usual": {},
    "weak": {"secant_exponent": 0.6, "detector_strength": 0.2},
    "strong": {"secant_exponent": 1.2, "detector_strength": 0.8},
    "albedo": {"albedo_contrast": 0.35},
    "no edges": {"edge_strength": 0.0},
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

SHADINGS = (
    *("usual", "strong", "albedo", "weak", "usual"),
    *("none", "strong", "usual", "weak", "usual"),
)
"""Of the ten series of a row."""


def ten(
    row: str, scenes: tuple[str, ...], seed: int, shapes: tuple[tuple[int, int], ...]
) -> tuple[Series, ...]:
    """A row of ten: scenes and shapes (images, degrees) in turn."""
    return tuple(
        series(row, scenes[k % len(scenes)], seed + k, *shapes[k % len(shapes)], SHADINGS[k])
        for k in range(10)
    )


TEST = (
    *ten("grain", ("grain",), 201, ((24, 115), (30, 150), (18, 80), (40, 178), (24, 100))),
    *ten(
        "clump, turn",
        ("clump", "grain"),
        221,
        ((24, 115), (48, 352), (16, 60), (60, 354), (36, 170)),
    ),
    *ten("small", ("grain", "clump"), 241, ((5, 20), (8, 40), (6, 12), (12, 60), (7, 30))),
    *ten("field", ("field",), 261, ((13, 60), (21, 80), (5, 10), (7, 20), (9, 40))),
)
"""Four rows of ten that nothing was chosen on."""


def large(name: str, scene: str, seed: int, shading: str = "usual", **options: Any) -> Series:
    """A series of the example's size."""
    return Series(
        name=name,
        row=scene,
        options=replace(
            example_options(),
            scene=scene,  # type: ignore[arg-type]
            seed=seed,
            **SHADING[shading],  # type: ignore[arg-type]
            **options,
        ),
    )


FIELD: dict[str, Any] = {"num_images": 21, "range_deg": 60.0, "step_deg": None}
LARGE = (
    large("example", "grain", 7),
    large("grain 11", "grain", 11),
    large("grain 15", "grain", 15),
    large("grain 17", "grain", 17),
    large("grain 12, weak shading", "grain", 12, "weak"),
    large("grain 13, strong shading", "grain", 13, "strong"),
    large("grain 14, more albedo", "grain", 14, "albedo"),
    large("example, no edges brightened", "grain", 7, "no edges"),
    large("example, no shading", "grain", 7, "none"),
    large("clump 31", "clump", 31),
    large("clump 32, strong shading", "clump", 32, "strong"),
    large("field 21", "field", 21, **FIELD),
    large("field 22", "field", 22, **FIELD),
)
"""The example, and others as large, on which the bias was first seen."""
