"""What the tomography formats share: the stack, the table of views, what the files cannot hold."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from semsfm_colmap.exports.fiducials import ViewErrors, view_errors
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.exports.tilt_series import HeldCameras, TiltSeries, measured_px
from semsfm_colmap.io.csv_cells import safe_cell
from semsfm_colmap.io.grey import read_grey

NAME = "series"
"""What the files of a series are called."""
NOTEWORTHY_PX = 0.05
"""Displacements below this are not worth a sentence."""


def write_stack(series: TiltSeries, scene: ExportScene, path: Path) -> None:
    """The images as an MRC stack of 16 bits, lowest row first as y points up."""
    import mrcfile

    width, height = series.size_px
    names = scene.reconstruction.image_names
    with mrcfile.new_mmap(path, (len(names), height, width), mrc_mode=1) as file:
        for k, name in enumerate(names):
            file.data[k] = read_grey(scene.image_path / name)[::-1]
        file.set_image_stack()
        file.voxel_size = pixel_angstrom(series, scene) or 0.0
        file.update_header_stats()


def pixel_angstrom(series: TiltSeries, scene: ExportScene) -> float | None:
    """Of the tomogram and the aligned images; None in a world of pixels."""
    return 1e4 / series.px_per_unit if scene.reconstruction.world_unit == "um" else None


def errors_of(series: TiltSeries, held: HeldCameras, scene: ExportScene) -> ViewErrors:
    """Errors with the cameras that a format holds."""
    return view_errors(held.linear, held.middle_px, *measured_px(series, scene))


def write_views(
    series: TiltSeries, scene: ExportScene, held: HeldCameras, errors: ViewErrors, path: Path
) -> None:
    """A row a view: names, angles, errors, and what the format drops of it in px (RMS)."""
    image, _, _ = measured_px(series, scene)
    count = np.maximum(np.bincount(image, minlength=len(scene.names)), 1)
    rms = np.sqrt(np.bincount(image, held.loss_px**2, len(scene.names)) / count)
    columns = {
        "rotation_deg": np.degrees(series.rotation_rad),
        "tilt_deg": np.degrees(series.tilt_rad),
        "out_of_plane_deg": np.degrees(series.out_of_plane_rad),
        "magnification": series.magnification,
        "residual_px": errors.residual_px,
        "leave_out_px": errors.leave_out_px,
        "not_held_px": rms,
    }
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["view", "image", "points", *columns])
        for k, name in enumerate(scene.names):
            values = [f"{column[k]:.5f}" for column in columns.values()]
            rows.writerow([k + 1, safe_cell(name), errors.num_points[k], *values])


def summary(
    series: TiltSeries, scene: ExportScene, held: HeldCameras, errors: ViewErrors, dropped: str
) -> Summary:
    """What export.json says, with a note of what the format cannot hold and how much that is.

    `dropped` names what it does not hold.
    """
    loss = held.loss_px
    rms, largest = float(np.sqrt(np.mean(loss**2))), float(loss.max(initial=0.0))
    loss_note = (
        f"the format does not hold {dropped}: {rms:.2g} px RMS over the observations, "
        f"{largest:.2g} px at most, by view in views.csv"
    )
    return {
        "num_images": len(scene.names),
        "num_points": len(scene.reconstruction.points),
        "tomogram_px_from_world": series.tomogram_px_from_world.tolist(),
        "residual_px": float(np.nanmean(errors.residual_px)),
        "leave_out_px": float(np.nanmean(errors.leave_out_px)),
        "rms_deviation_px": rms,
        "max_deviation_px": largest,
        "notes": [loss_note, *_notes(scene)],
    }


def out_of_plane_words(series: TiltSeries) -> str:
    """That the axis leaves the image plane, and how far."""
    b = np.degrees(series.out_of_plane_rad)
    return (
        f"that the tilt axis leaves the image planes, by {np.mean(b):.2g} degrees in the mean and "
        f"{np.std(b):.2g} about that"
    )


def _notes(scene: ExportScene) -> list[str]:
    """What the images have and the measured points have not, and an open hand."""
    reconstruction = scene.reconstruction
    notes = []
    if reconstruction.drift_px is not None:
        largest = float(np.linalg.norm(reconstruction.drift_px, axis=1).max(initial=0.0))
        if largest > NOTEWORTHY_PX:
            notes.append(
                f"a scan drift of up to {largest:.2g} px from the first row to the last was taken "
                "out of the measured points; the images have it still"
            )
    drag = reconstruction.drag_px
    if drag is not None and abs(drag) > NOTEWORTHY_PX:
        notes.append(
            f"the drag of the shading, coefficient {drag:.2g} px, was taken out "
            "of the measured points; the images have it still"
        )
    if reconstruction.depth_sign.status == "ambiguous":
        notes.append(
            "the hand of the model is not decided: all tilts may have the other sign, which "
            "mirrors the tomogram in depth"
        )
    return notes
