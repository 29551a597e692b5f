"""orthographic.json: what COLMAP's model cannot hold. Format version 1."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.names import check_names
from semsfm_colmap.io.versions import check_version
from semsfm_colmap.types import DepthSign, Float, OrthographicCameras, Reconstruction

FORMAT = "semsfm-orthographic"
VERSION = 1
FILE_NAME = "orthographic.json"


def sidecar_dict(
    reconstruction: Reconstruction,
    focal_length_px: float,
    max_deviation_px: float,
    reliability: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The content of the file, in its documented order.

    Parameters
    ----------
    reliability : how far to trust the model as a whole: total rotation with its error bar, what
        leaving an image out does; absent from the file when nothing is known

    """
    cameras = reconstruction.cameras
    sign = reconstruction.depth_sign
    images: dict[str, Any] = {}
    for i, name in enumerate(reconstruction.image_names):
        entry: dict[str, Any] = {
            "cam_from_world": cameras.cam_from_world[i].tolist(),
            "scale_px_per_unit": float(cameras.scale_px_per_unit[i]),
            "translation_px": cameras.translation_px[i].tolist(),
        }
        if reconstruction.sigma_rotation_rad is not None:
            entry["sigma_rotation_deg"] = np.rad2deg(reconstruction.sigma_rotation_rad[i]).tolist()
        if reconstruction.sigma_translation_px is not None:
            entry["sigma_translation_px"] = reconstruction.sigma_translation_px[i].tolist()
        if reconstruction.sigma_scale is not None:
            entry["sigma_scale_relative"] = float(reconstruction.sigma_scale[i])
        images[name] = entry
    pixel_size = None
    if reconstruction.pixel_size_um is not None:
        pixel_size = {
            "value": reconstruction.pixel_size_um,
            "unit": "um",
            "source": reconstruction.pixel_size_source,
        }
    data: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "world_unit": reconstruction.world_unit,
        "pixel_size": pixel_size,
        "depth_sign": {
            "status": sign.status,
            "evidence": dict(sign.evidence),
            "confidence": sign.confidence,
            "message": sign.message,
        },
        "camera_model": reconstruction.camera_model,
        "aspect": cameras.aspect,
        "skew": cameras.skew,
        "telecentric": {"focal_length_px": focal_length_px, "max_deviation_px": max_deviation_px},
        "images": images,
        "gauge": reconstruction.gauge,
    }
    if reliability:
        data["reliability"] = dict(reliability)
    return data


def read_sidecar(path: Path) -> dict[str, Any]:
    """Read and check orthographic.json."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): run `semsfm map`") from error
    except ValueError as error:
        raise InputError(f"{path} is not valid JSON: run `semsfm map` again") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise InputError(f"{path} is not a {FORMAT} file: run `semsfm map` again")
    check_version(data, VERSION, path, "run `semsfm map` again")
    try:
        _check(data)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path} is damaged ({type(error).__name__}: {error}): run `semsfm map` again"
        ) from error
    check_names(data["images"], path)
    return data


def _check(data: dict[str, Any]) -> None:
    """Whether all that is read later is there, and numbers are numbers."""
    shapes = {"cam_from_world": (3, 3), "scale_px_per_unit": (), "translation_px": (2,)}
    for name, entry in data["images"].items():
        for key, shape in shapes.items():
            value = np.array(entry[key], dtype=np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"{key} of {name!r}")
    numbers = (data["aspect"], data["skew"], data["telecentric"]["focal_length_px"])
    if not np.isfinite(np.array(numbers, dtype=np.float64)).all():
        raise ValueError("aspect, skew or focal_length_px is not finite")
    for key in ("world_unit", "pixel_size", "camera_model", "gauge"):
        data[key]
    dict(data.get("reliability", {}))
    depth_sign_from_sidecar(data)


def cameras_from_sidecar(data: dict[str, Any], names: tuple[str, ...]) -> OrthographicCameras:
    """The cameras of some images, exactly as they were written."""
    entries = [data["images"][name] for name in names]
    return OrthographicCameras(
        cam_from_world=np.array([e["cam_from_world"] for e in entries], dtype=np.float64),
        scale_px_per_unit=np.array([e["scale_px_per_unit"] for e in entries], dtype=np.float64),
        translation_px=np.array([e["translation_px"] for e in entries], dtype=np.float64),
        aspect=float(data["aspect"]),
        skew=float(data["skew"]),
    )


def drift_from_sidecar(data: dict[str, Any], names: tuple[str, ...]) -> Float | None:
    """The scan drift that the images have and the model has not: (M, 2) px, if there is any."""
    drift = data.get("reliability", {}).get("drift_px")
    if not drift:
        return None
    return np.array([drift.get(name, (0.0, 0.0)) for name in names], dtype=np.float64)


def depth_sign_from_sidecar(data: dict[str, Any]) -> DepthSign:
    """The verdict on the hand."""
    sign = data["depth_sign"]
    return DepthSign(
        status=sign["status"],
        confidence=float(sign["confidence"]),
        evidence=dict(sign["evidence"]),
        message=str(sign.get("message", "")),
    )
