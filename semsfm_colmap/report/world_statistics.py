"""The world of a model: its unit, the pixel size, the camera model and the gauge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.report.inputs import ReportInputs


@dataclass(frozen=True, kw_only=True)
class WorldMetrics:
    """What a length in the model means."""

    unit: str
    pixel_size_nm: float | None
    pixel_size_source: str
    median_scale_px_per_world: float | None
    camera_model: str
    aspect: float
    skew: float
    gauge: str


def pixel_size_nm(inputs: ReportInputs) -> float | None:
    """Pixel size of the images: as the model states it, else the series, else from its scales."""
    rec = inputs.reconstruction
    um = rec.pixel_size_um if rec.pixel_size_um is not None else inputs.series.pixel_size_um
    if um is None and rec.world_unit == "um" and rec.num_images > 0:
        um = 1.0 / float(np.median(rec.cameras.scale_px_per_unit))
    return None if um is None else 1000.0 * um


def world_statistics(inputs: ReportInputs) -> WorldMetrics:
    """Unit, pixel size and camera model, as the model and the series state them."""
    rec = inputs.reconstruction
    known = rec.pixel_size_source != "none"
    scale = float(np.median(rec.cameras.scale_px_per_unit)) if rec.num_images else None
    return WorldMetrics(
        unit=rec.world_unit,
        pixel_size_nm=pixel_size_nm(inputs),
        pixel_size_source=rec.pixel_size_source if known else inputs.series.pixel_size_source,
        median_scale_px_per_world=scale,
        camera_model=rec.camera_model,
        aspect=rec.cameras.aspect,
        skew=rec.cameras.skew,
        gauge=rec.gauge,
    )
