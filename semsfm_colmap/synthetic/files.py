"""The files of a synthetic series: images, truth.json, truth.npz, mesh.npz, displacement.csv."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.synthetic.databar import BarText
from semsfm_colmap.synthetic.motion import SCENE_DEFAULTS, Motion, image_rows
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.scenes.base import Specimen
from semsfm_colmap.synthetic.zeiss import CZ_SEM_TAG, cz_sem_header
from semsfm_colmap.types import Array

CONVENTION = (
    "x_cam = R @ X (x right, y down, z away from the viewer); uv = scale * K2 @ x_cam[:2] + t;"
    " the centre of the first pixel is (0.5, 0.5). Scan line r shows this image displaced by"
    " ((r + 0.5) / rows - 0.5) * frame_drift_px + (row_jitter_px[r], 0); row_jitter_px is in"
    " truth.npz. The size of a pixel is unit_um / scale micrometres."
)


def prepare_folder(output_path: Path) -> Path:
    """Make the folder and its `images`; refuse images of another run."""
    image_path = output_path / "images"
    try:
        image_path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"Cannot write to {output_path}: {error.strerror}.") from error
    if any(image_path.iterdir()):
        raise UsageError(f"{image_path} is not empty: choose another folder or empty it.")
    return image_path


def write_image(
    path: Path,
    pixels: Array,
    options: SynthesizeOptions,
    text: BarText,
    motion: Motion,
    image_idx: int,
) -> None:
    """Write one image as PNG, or as TIFF with the header of a Zeiss microscope."""
    if options.image_format == "png":
        import cv2

        if not cv2.imwrite(str(path), pixels):
            raise UsageError(f"Cannot write {path}.")
        return
    import tifffile

    extratags = []
    if options.zeiss_header:
        # What is not a sheet is turned by what holds it, not by the stage.
        tilted = SCENE_DEFAULTS[options.scene].tilted
        tilt = float(motion.nominal_deg[image_idx]) if tilted else 0.0
        height, width = pixels.shape
        header = cz_sem_header(text, width=width, height=height, tilt_deg=tilt, file_name=path.name)
        extratags = [(CZ_SEM_TAG, tifffile.DATATYPE.ASCII, len(header), header, True)]
    tifffile.imwrite(
        path, pixels, photometric="minisblack", metadata=None, software=False, extratags=extratags
    )


def write_truth(
    output_path: Path,
    options: SynthesizeOptions,
    motion: Motion,
    specimen: Specimen,
    names: list[str],
) -> None:
    """Write everything but the images."""
    cameras = motion.cameras
    rows = image_rows(options)
    steps = np.diff(motion.nominal_deg)
    frames: list[dict[str, Any]] = []
    for i, name in enumerate(names):
        frames.append(
            {
                "name": name,
                "nominal_deg": float(motion.nominal_deg[i]),
                "true_deg": float(motion.true_deg[i]),
                "R": cameras.cam_from_world[i].tolist(),
                "t": cameras.translation_px[i].tolist(),
                "scale": float(cameras.scale_px_per_unit[i]),
                "nuisance": {
                    "row_jitter_rms_px": float(np.sqrt(np.mean(motion.row_jitter_px[i] ** 2))),
                    "frame_drift_px": motion.frame_drift_px[i].tolist(),
                    "psf_px": float(motion.psf_px[i]),
                    "gain": float(motion.gain[i]),
                },
            }
        )
    truth = {
        "kind": options.scene,
        "seed": options.seed,
        "width": options.width_px,
        "height": options.height_px,
        "databar_rows": options.height_px - rows,
        "image_area": [0, 0, options.width_px, rows],
        "convention": CONVENTION,
        "K2": cameras.K2.tolist(),
        "rotation_axis_cam": motion.axis.tolist(),
        "nominal_step_deg": float(steps.mean()) if len(steps) else 0.0,
        "unit_um": motion.unit_um,
        "pixel_size_um": float(motion.unit_um / cameras.scale_px_per_unit.mean()),
        "meta": {
            **specimen.facts,
            "unit_um": motion.unit_um,
            "natural_unit_um": SCENE_DEFAULTS[options.scene].unit_um,
        },
        "render": asdict(options),
        "frames": frames,
    }
    if motion.displacement_um is not None:
        truth["degrees_per_um"] = options.degrees_per_um
        lines = [f"{n},{d:.4f}" for n, d in zip(names, motion.displacement_um, strict=True)]
        csv = "\n".join(["image,displacement_um", *lines]) + "\n"
        (output_path / "displacement.csv").write_text(csv, encoding="utf-8")
    text = json.dumps(truth, indent=1) + "\n"
    (output_path / "truth.json").write_text(text, encoding="utf-8")
    np.savez(
        output_path / "truth.npz",
        R=cameras.cam_from_world,
        t=cameras.translation_px,
        scale=cameras.scale_px_per_unit,
        K2=cameras.K2,
        nominal_deg=motion.nominal_deg,
        true_deg=motion.true_deg,
        axis=motion.axis,
        names=np.array(names),
        frame_drift_px=motion.frame_drift_px,
        row_jitter_px=motion.row_jitter_px,
    )
    np.savez_compressed(
        output_path / "mesh.npz",
        vertices=specimen.vertices.astype(np.float32),
        faces=specimen.faces.astype(np.uint32),
        vertex_label=specimen.label.astype(np.uint8),
    )
