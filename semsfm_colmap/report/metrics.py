"""The numbers of the report, and nothing but numbers: `docs/report.md` says what each one means.

Keys carry their unit (``_px _nm _deg _seconds _mb``); ``_world`` stands for the unit in
``world.unit``. None stands for "not known", never for zero. Frames are numbered from 1 in the
order of acquisition.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from semsfm_colmap.report.frames import Frames, order_frames
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.json_text import plain
from semsfm_colmap.report.match_statistics import match_totals, matches_per_frame, rejected_pairs
from semsfm_colmap.report.mesh_statistics import mesh_statistics
from semsfm_colmap.report.motion_statistics import motion_statistics
from semsfm_colmap.report.residual_statistics import residual_statistics
from semsfm_colmap.types import Array, Float, Int, Reconstruction

FORMAT = "semsfm-metrics"
VERSION = 1


def pixel_size_nm(inputs: ReportInputs) -> float | None:
    """Pixel size of the images: as the model states it, else the series, else from its scales."""
    rec = inputs.reconstruction
    um = rec.pixel_size_um if rec.pixel_size_um is not None else inputs.series.pixel_size_um
    if um is None and rec.world_unit == "um" and rec.num_images > 0:
        um = 1.0 / float(np.median(rec.cameras.scale_px_per_unit))
    return None if um is None else 1000.0 * um


def co_visibility(reconstruction: Reconstruction, frames: Frames) -> Int:
    """(M, M) tracks that two registered frames share; the diagonal counts those of each."""
    from scipy.sparse import csr_array

    obs, kept = reconstruction.observations, reconstruction.inlier
    row, column = frames.rank_of_image()[obs.image_idx[kept]], obs.track_idx[kept]
    shape = (len(frames.registered), len(reconstruction.points))
    seen = csr_array((np.ones(len(row), dtype=np.int64), (row, column)), shape=shape)
    seen.data[:] = 1
    return np.asarray((seen @ seen.T).toarray(), dtype=np.int64)


def _world(inputs: ReportInputs) -> dict[str, Any]:
    rec, nm = inputs.reconstruction, pixel_size_nm(inputs)
    known = rec.pixel_size_source != "none"
    scale = float(np.median(rec.cameras.scale_px_per_unit)) if rec.num_images else None
    return {
        "unit": rec.world_unit,
        "pixel_size_nm": nm,
        "pixel_size_source": rec.pixel_size_source if known else inputs.series.pixel_size_source,
        "median_scale_px_per_world": scale,
        "camera_model": rec.camera_model,
        "aspect": rec.cameras.aspect,
        "skew": rec.cameras.skew,
        "gauge": rec.gauge,
    }


def _structure(rec: Reconstruction) -> dict[str, Any]:
    length = rec.track_length()
    seen = length[length >= 1]
    out: dict[str, Any] = {
        "num_points": len(rec.points),
        "num_observations": int(rec.inlier.sum()),
        "num_rejected_observations": int((~rec.inlier).sum()),
        "rejected_fraction": float((~rec.inlier).mean()) if len(rec.inlier) else None,
        "mean_track_length": float(seen.mean()) if len(seen) else None,
        "median_track_length": float(np.median(seen)) if len(seen) else None,
        "max_track_length": int(seen.max()) if len(seen) else None,
        "num_points_in_3_or_more_images": int((length >= 3).sum()),
        "track_length_counts": np.bincount(length).tolist() if len(length) else [],
    }
    if rec.point_covariance is not None and len(rec.points):
        sigma = np.sqrt(np.trace(rec.point_covariance, axis1=1, axis2=2))
        sigma = sigma[np.isfinite(sigma)]
        if len(sigma):
            out["median_point_sigma_world"] = float(np.median(sigma))
            out["p95_point_sigma_world"] = float(np.percentile(sigma, 95))
    return out


def _rounds(inputs: ReportInputs) -> list[dict[str, Any]]:
    rows = []
    for filtering_round in inputs.filtering_rounds:
        kept, dropped = filtering_round["num_kept"], filtering_round["num_dropped"]
        fraction = dropped / (kept + dropped) if kept + dropped else None
        rows.append({**filtering_round, "dropped_fraction": fraction})
    return rows


def _by_image(values: Array | None, frames: Frames) -> Array:
    """The rows of an optional per-image array in frame order, nan where there is none."""
    if values is None:
        return np.full(len(frames.image_idx), np.nan)
    return values[frames.image_idx]


def _per_image(
    inputs: ReportInputs, frames: Frames, residual: Float, columns: dict[str, Float]
) -> list[dict[str, Any]]:
    """One row for each image given, registered or not."""
    rec = inputs.reconstruction
    num = rec.num_images
    idx, kept = rec.observations.image_idx, rec.inlier
    count = np.bincount(idx[kept], minlength=num)[frames.image_idx]
    total = np.bincount(idx, minlength=num)[frames.image_idx]
    square = np.bincount(idx[kept], weights=np.sum(residual[kept] ** 2, axis=1), minlength=num)
    rms = np.sqrt(square[frames.image_idx] / np.where(count > 0, 2.0 * count, np.nan))
    scale = rec.cameras.scale_px_per_unit[frames.image_idx]
    sigma_rotation = _by_image(rec.sigma_rotation_rad, frames)
    columns = columns | {
        "num_observations": count,
        "num_rejected_observations": total - count,
        "rms_px": rms,
        "scale_px_per_world": scale,
        "relative_scale": scale / np.median(scale) if num else scale,
        "sigma_relative_scale": _by_image(rec.sigma_scale, frames),
        "sigma_rotation_deg": np.rad2deg(sigma_rotation),
        "sigma_translation_px": _by_image(rec.sigma_translation_px, frames),
    }
    matches = matches_per_frame(inputs.pairs, frames.names)
    rank = {int(k): m for m, k in enumerate(frames.registered)}
    rows = []
    for k, name in enumerate(frames.names):
        row: dict[str, Any] = {"frame": k + 1, "name": name, "registered": k in rank}
        row |= {key: values[k] for key, values in matches.items()}
        if k in rank:
            row |= {key: values[rank[k]] for key, values in columns.items()}
        rows.append(row)
    return rows


def compute_metrics(inputs: ReportInputs) -> dict[str, Any]:
    """All numbers of the report as plain dicts and lists, ready for JSON."""
    rec = inputs.reconstruction
    frames = order_frames(inputs)
    residual = rec.residuals()
    nm = pixel_size_nm(inputs)
    motion, columns = motion_statistics(inputs, frames)
    sign = rec.depth_sign
    shared = co_visibility(rec, frames)
    metrics = {
        "format": FORMAT,
        "version": VERSION,
        "images": {
            "num_given": len(frames.names),
            "num_registered": len(frames.registered),
            "missing": frames.missing,
        },
        "world": _world(inputs),
        "structure": _structure(rec),
        "residuals": residual_statistics(rec, residual, nm),
        "rotation": motion,
        "reliability": dict(inputs.reliability),
        "depth_sign": {
            "status": sign.status,
            "confidence": sign.confidence,
            "evidence": dict(sign.evidence),
            "message": sign.message,
            "twin_written": inputs.twin_written,
        },
        "matches": match_totals(inputs.pairs) | {"rejected": rejected_pairs(inputs.pairs)},
        "filtering_rounds": _rounds(inputs),
        "guided": dict(inputs.guided) or None,
        "telecentric": dict(inputs.telecentric),
        "mesh": None if inputs.mesh is None else mesh_statistics(inputs.mesh),
        "cloud": None if inputs.cloud is None else {"num_points": len(inputs.cloud.points)},
        "stages": [
            {"name": name, "seconds": s, "peak_memory_mb": inputs.stage_peak_memory_mb.get(name)}
            for name, s in inputs.stage_times.items()
        ],
        "versions": dict(inputs.versions),
        "notes": [*inputs.notes, *inputs.series.warnings],
        "per_image": _per_image(inputs, frames, residual, columns),
        "co_visibility": {"frames": frames.numbers, "num_shared_tracks": shared},
    }
    result: dict[str, Any] = plain(metrics)
    return result
