"""Rendered belts measured by their images: degrees per um, axis, wobble, path and hysteresis.

Ten clumps of spores on a ribbon with a known conversion, other seeds, factors, numbers of images
and ranges: `semsfm goniometer` on each against the truth. The pull is error over stated standard
deviation. Hysteresis is put into the read-outs: every other image is taken as one of the way back.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import tables
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import Config, read_config
from semsfm_colmap.evaluation.truth import Truth, load_truth
from semsfm_colmap.mapping.pose_covariance import rotation_covariance
from semsfm_colmap.motion.goniometer import Readout, image_frame_of_axis, measure_goniometer
from semsfm_colmap.pipeline.goniometer import measure_rotation
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.records import GoniometerRecord
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.series import synthesize
from semsfm_colmap.types import Float

STAGES = ("ingest", "extract", "match", "map")
HYSTERESIS_DEG = 2.0
WIDTH_PX, HEIGHT_PX, DATABAR_ROWS = 480, 390, 30


@dataclass(frozen=True, kw_only=True)
class Belt:
    """One rendered series."""

    seed: int
    num_images: int
    range_deg: float
    degrees_per_um: float

    @property
    def name(self) -> str:
        """Of its folder and its row."""
        return f"belt_{self.seed}_{self.num_images}x{self.range_deg:.0f}"


BELTS = (
    Belt(seed=901, num_images=24, range_deg=115.0, degrees_per_um=120.0),
    Belt(seed=902, num_images=60, range_deg=354.0, degrees_per_um=171.3),
    Belt(seed=903, num_images=20, range_deg=95.0, degrees_per_um=90.0),
    Belt(seed=904, num_images=36, range_deg=175.0, degrees_per_um=260.0),
    Belt(seed=905, num_images=30, range_deg=145.0, degrees_per_um=200.0),
    Belt(seed=906, num_images=48, range_deg=352.0, degrees_per_um=105.0),
    Belt(seed=907, num_images=20, range_deg=60.0, degrees_per_um=230.0),
    Belt(seed=908, num_images=40, range_deg=240.0, degrees_per_um=150.0),
    Belt(seed=909, num_images=28, range_deg=135.0, degrees_per_um=185.0),
    Belt(seed=910, num_images=54, range_deg=310.0, degrees_per_um=140.0),
)
HEAD = (
    "series",
    "images",
    "true deg/um",
    "found deg/um",
    "pull",
    "axis: error (sigma) deg",
    "axis: pulls in the image plane, out of it",
    "wobble: correlation",
    "path: correlation",
    "hysteresis of 2 deg: found",
)


def rendered(belt: Belt, folder: Path) -> Path:
    """The folder of a rendered and mapped belt; what is there is taken as it is."""
    home = folder / belt.name
    if not (home / "truth.json").is_file():
        options = SynthesizeOptions(
            scene="clump",
            seed=belt.seed,
            num_images=belt.num_images,
            range_deg=belt.range_deg,
            degrees_per_um=belt.degrees_per_um,
            width_px=WIDTH_PX,
            height_px=HEIGHT_PX,
            databar_rows=DATABAR_ROWS,
        )
        synthesize(home, options)
    run_stages(home / "project", Config(), names=STAGES, image_path=home / "images")
    return home


def axis_error_deg(record: GoniometerRecord, truth: Truth) -> float:
    """Angle between the axes in the camera frame."""
    cosine = abs(float(np.dot(record.axis_camera, truth.axis)))
    return float(np.rad2deg(np.arccos(min(cosine, 1.0))))


def axis_pulls(record: GoniometerRecord, truth: Truth) -> Float:
    """Errors (2,) of the axis within the image plane and out of it over their sigmas."""
    axis = np.array(record.axis_camera)
    side = 1.0 if axis @ truth.axis > 0.0 else -1.0
    off = (axis - side * truth.axis) @ image_frame_of_axis(axis)
    return np.rad2deg(off) / np.array(record.axis_camera_sigmas_deg)


def wobble_correlation(record: GoniometerRecord, truth: Truth) -> float:
    """Of the axis in each image against the common one, in the image plane and out of it."""
    rows = [truth.names.index(name) for name in record.images]
    true = truth.cameras.cam_from_world[rows] @ truth.axis
    axis = np.array(record.axis_camera)
    side = 1.0 if axis @ truth.axis > 0.0 else -1.0
    true = side * true @ image_frame_of_axis(axis)
    seen = np.array([image.axis_offset_deg for image in record.images.values()])
    return min(float(np.corrcoef(true[:, k], seen[:, k])[0, 1]) for k in (0, 1))


def path_correlation(record: GoniometerRecord, truth: Truth, centre: Float) -> float:
    """Of the specimen's centre in the images: the lesser of x and y."""
    rows = np.array([truth.names.index(name) for name in record.images])
    P, t = truth.cameras.projection[rows], truth.cameras.translation_px[rows]
    # the centre of the points in the truth's world, from where all images see it
    X = np.linalg.lstsq(P.reshape(-1, 3), (centre - t).reshape(-1), rcond=None)[0]
    true = t + P @ X
    seen = np.array([image.shift_px for image in record.images.values()])
    return min(float(np.corrcoef(true[:, k], seen[:, k])[0, 1]) for k in (0, 1))


def read_table(path: Path) -> dict[str, float]:
    """Displacement of each image."""
    with path.open(encoding="utf-8") as file:
        return {row["image"]: float(row["displacement_um"]) for row in csv.DictReader(file)}


def hysteresis_found(home: Path, project: Path, factor: float) -> tuple[float, float]:
    """Every other image taken on the way back, its read-out late by half of 2 degrees each way."""
    model = read_model(project / "sparse" / "0")
    said = read_table(home / "displacement.csv")
    config = read_config(project / "semsfm.toml")
    M = model.num_images
    images = np.concatenate([np.arange(0, M, 2), np.arange(1, M, 2)[::-1]])
    way = np.where(images % 2 == 0, 1.0, -1.0)
    value = np.array([said[model.image_names[k]] for k in images])
    covariance = rotation_covariance(model, config.refinement, None)
    if covariance is not None:
        rows = (3 * images[:, None] + np.arange(3)).reshape(-1)
        covariance = covariance[np.ix_(rows, rows)]
    found = measure_goniometer(
        model.cameras.select(images),
        np.zeros(3),
        displacement=Readout(value=value - 0.5 * way * HYSTERESIS_DEG / factor),
        tilt=Readout(value=np.full(M, np.nan)),
        covariance=covariance,
    )
    assert found is not None
    line = found.displacement
    assert line is not None
    assert line.hysteresis_rad is not None
    assert line.hysteresis_sigma_rad is not None
    return float(np.rad2deg(line.hysteresis_rad)), float(np.rad2deg(line.hysteresis_sigma_rad))


def row(name: str, home: Path, project: Path, factor: float) -> tuple[list[Any], float, Float]:
    """One row of the table, the pull of its factor, and those of its axis."""
    record = measure_rotation(project, displacement_path=home / "displacement.csv")
    truth = load_truth(home)
    model = read_model(project / "sparse" / "0")
    number = {image: k for k, image in enumerate(model.image_names)}
    images = np.array([number[image] for image in record.images])
    middle = np.broadcast_to(model.points.mean(axis=0), (len(images), 3))
    centre = model.cameras.project(middle, images)
    found = record.conversion_deg_per_um
    assert found is not None
    pull = (found.value - factor) / found.sigma
    tilted = axis_pulls(record, truth)
    back, back_sigma = hysteresis_found(home, project, factor)
    cells = [
        name,
        len(record.images),
        f"{factor:.1f}",
        f"{found.value:.2f} +- {found.sigma:.2f}",
        f"{pull:+.2f}",
        f"{axis_error_deg(record, truth):.3f} ({record.axis_camera_sigma_deg:.3f})",
        f"{tilted[0]:+.2f}, {tilted[1]:+.2f}",
        f"{wobble_correlation(record, truth):.4f}",
        f"{path_correlation(record, truth, centre):.4f}",
        f"{back:.2f} +- {back_sigma:.2f}",
    ]
    return cells, pull, tilted


def main() -> None:
    """Render, map, measure and print."""
    parser = tables.parser("goniometer", __doc__)
    tables.add_page_option(parser, "goniometer")
    parser.add_argument("folder", type=Path, help="for the rendered belts; reused where they are")
    parser.add_argument("--spore", type=Path, help="a series with truth and displacement.csv")
    parser.add_argument("--spore_project", type=Path, help="a copy of its mapped project")
    arguments = parser.parse_args()
    rows, pulls, axes = [], [], []
    if arguments.spore is not None:
        cells, *_ = row("synth_spore", arguments.spore, arguments.spore_project, 171.3)
        rows.append(cells)
        print(tables.line(cells), flush=True)
    for belt in BELTS:
        home = rendered(belt, arguments.folder)
        cells, pull, tilted = row(belt.name, home, home / "project", belt.degrees_per_um)
        rows.append(cells)
        pulls.append(pull)
        axes.append(tilted)
        print(tables.line(cells), flush=True)
    rms, of_axes = (float(np.sqrt(np.mean(np.square(some)))) for some in (pulls, axes))
    said = (
        f"RMS of the ten pulls of the conversion: {rms:.2f}; of twenty of the axis: {of_axes:.2f}."
    )
    print(said)
    if arguments.markdown is not None:
        tables.put(arguments.markdown, "goniometer", f"{tables.table(HEAD, rows)}\n\n{said}")


if __name__ == "__main__":
    main()
