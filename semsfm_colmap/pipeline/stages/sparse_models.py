"""Observations of a series -> COLMAP models with the sidecar, wherever they come from."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.types import Float, Int, Observations, SemSeries

if TYPE_CHECKING:
    from semsfm_colmap.colmap.database.work import DatabaseImage
    from semsfm_colmap.mapping.finish import MappedPart
    from semsfm_colmap.mapping.guided import Guide

Summary = dict[str, Any]
TWIN_NOTE = "{}/1 holds the depth-reversed twin of {}/0"
MIN_PAIR_MATCHES = 5
"""Below this an affine fundamental matrix fits anything: four matches determine it."""


def join_matches(
    keypoints: Sequence[Float], matches: Mapping[tuple[int, int], Int], config: Config
) -> tuple[Observations, dict[str, int]]:
    """Verified matches of pairs (i, j) -> tracks, with the counts of the joining.

    Parameters
    ----------
    keypoints : (K, 2) px of each image, in acquisition order
    matches : (L, 2) keypoint indices of each pair of image numbers

    """
    from semsfm_colmap.geometry.epipolar import epipolar_residual, estimate_affine_fundamental
    from semsfm_colmap.tracks.build import build_tracks
    from semsfm_colmap.tracks.cycles import consistent_matches

    ordered = {
        (min(pair), max(pair)): rows if pair[0] < pair[1] else rows[:, ::-1]
        for pair, rows in matches.items()
    }
    num_inconsistent = 0
    if config.tracks.cycle_consistency:
        keep = consistent_matches([len(xy) for xy in keypoints], ordered)
        num_inconsistent = sum(int((~good).sum()) for good in keep.values())
        ordered = {pair: rows[keep[pair]] for pair, rows in ordered.items()}
    usable, residuals = {}, {}
    for (i, j), rows in ordered.items():
        if len(rows) < MIN_PAIR_MATCHES:
            continue
        xy1, xy2 = keypoints[i][rows[:, 0]], keypoints[j][rows[:, 1]]
        usable[i, j] = rows
        residuals[i, j] = epipolar_residual(estimate_affine_fundamental(xy1, xy2), xy1, xy2)
    observations, counts = build_tracks(
        list(keypoints), usable, residuals, min_length=config.tracks.min_length
    )
    return observations, {**counts, "num_inconsistent": num_inconsistent}


def map_series(
    series: SemSeries,
    keypoints: Mapping[str, Float],
    database_images: dict[str, DatabaseImage],
    observations: Observations,
    track_counts: Mapping[str, int],
    config: Config,
    reporter: Reporter,
    *,
    sparse_path: Path,
    image_path: Path | None,
    guide: Guide | None = None,
    write_guided: Callable[[Mapping[str, Float], Sequence[MappedPart]], None] | None = None,
) -> Summary:
    """Cameras and points into ``sparse_path/0`` (and the twin or further parts); the summary.

    Parameters
    ----------
    keypoints : (K, 2) px of each image, all of them: what the model's images hold
    database_images : the ids the model takes over
    image_path : for the colours of the points; None leaves them grey
    guide, write_guided : the images for the guided pass, and where the keypoints it adds are put

    """
    from semsfm_colmap.ingest.series.tilt import tilt_prior
    from semsfm_colmap.mapping.guided import append_keypoints
    from semsfm_colmap.mapping.parts import map_observations

    reporter.say(
        f"tracks: {observations.num_tracks} tracks, {len(observations)} observations, "
        f"{track_counts['num_refused']} contradictory matches refused"
    )
    solution = map_observations(
        observations,
        series.names,
        np.array([(frame.width_px, frame.height_px) for frame in series.frames]),
        factorization=config.factorization,
        refinement=config.refinement,
        pixel_size_um=series.pixel_size_um,
        pixel_size_source=series.pixel_size_source,
        tilt=tilt_prior(series, config.ingest),
        guide=guide,
        seed=config.seed,
        note=reporter.detail,
    )
    if solution.value is None:
        raise InputError(solution.message)
    parts, all_keypoints = append_keypoints(solution.value, keypoints)
    if write_guided is not None:
        write_guided(all_keypoints, parts)
    models = write_parts(parts, sparse_path, database_images, all_keypoints, config, image_path)
    main = parts[0]
    notes = [
        main.reconstruction.depth_sign.message,
        *main.diagnostics["notes"],
        *part_notes(parts, models, series.names),
    ]
    r = main.reconstruction
    residuals = r.residuals()[r.inlier]
    reporter.say(
        f"map: {r.num_images} of {len(series.names)} images, {len(r.points)} points, residual "
        f"{np.sqrt(np.mean(residuals**2)):.3f} px RMS per coordinate"
    )
    for sentence in notes:
        reporter.say(sentence)
    return {
        "num_images": r.num_images,
        "num_points": len(r.points),
        "num_observations": int(r.inlier.sum()),
        "rms_px": float(np.sqrt(np.mean(residuals**2))),
        "tracks": {"num_tracks": observations.num_tracks, **track_counts},
        "models": models,
        "rounds": list(main.rounds),
        "diagnostics": main.diagnostics,
        "reliability": main.reliability,
        "notes": notes,
    }


def write_parts(
    parts: Sequence[MappedPart],
    sparse_path: Path,
    database_images: dict[str, DatabaseImage],
    keypoints: dict[str, Float],
    config: Config,
    image_path: Path | None,
) -> list[dict[str, Any]]:
    """Write every part and its twin as a model of its own, numbered from 0; what was written."""
    from semsfm_colmap.colmap.model.colors import point_colors
    from semsfm_colmap.colmap.model.sparse import write_model

    models: list[dict[str, Any]] = []
    for k, part in enumerate(parts):
        value = part.reconstruction
        color = None if image_path is None else point_colors(value, image_path)
        kinds = [("model", value)] + ([("twin", part.twin)] if part.twin is not None else [])
        for kind, reconstruction in kinds:
            number = len(models)
            written = write_model(
                replace(reconstruction, point_color=color),
                sparse_path / str(number),
                database_images,
                keypoints,
                config.export,
                reliability=part.reliability,
            )
            models.append(
                {
                    "model": f"{sparse_path.name}/{number}",
                    "part": k,
                    "kind": kind,
                    "num_images": reconstruction.num_images,
                    "images": list(reconstruction.image_names),
                    "num_points": len(reconstruction.points),
                    "focal_length_px": written.focal_length_px,
                    "max_deviation_px": written.max_deviation_px,
                }
            )
    remove_stale_models(sparse_path, len(models))
    return models


def part_notes(
    parts: Sequence[MappedPart], models: Sequence[dict[str, Any]], names: Sequence[str]
) -> list[str]:
    """Sentences about the twin, about images left out, and about a series that fell apart."""
    notes = []
    if parts[0].twin is not None:
        folder = models[0]["model"].rsplit("/", 1)[0]
        notes.append(TWIN_NOTE.format(folder, folder))
    used = {name for part in parts for name in part.reconstruction.image_names}
    lost = [name for name in names if name not in used]
    if lost:
        notes.append(
            f"{len(lost)} of {len(names)} images could not be registered: "
            + ", ".join(lost[:8])
            + (" ..." if len(lost) > 8 else "")
        )
    if len(parts) > 1:
        notes.append(
            f"the series falls into {len(parts)} parts that share too few tracks; each "
            "is a model of its own with its own scale and axes: "
            + "; ".join(
                f"{m['model']} ({m['num_images']} images)" for m in models if m["kind"] == "model"
            )
        )
    return notes


def remove_stale_models(sparse_path: Path, count: int) -> None:
    """Models of an earlier run with higher numbers do not belong to this one.

    A folder without our sidecar is another program's and stays.
    """
    from semsfm_colmap.colmap.model.sidecar import FILE_NAME

    for folder in sparse_path.iterdir():
        numbered = folder.name.isdigit() and int(folder.name) >= count
        aside = folder.name.startswith(".") and folder.name.endswith((".part", ".old"))
        if aside or (numbered and (folder / FILE_NAME).is_file()):
            shutil.rmtree(folder)
