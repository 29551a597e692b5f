"""Observations of a series -> COLMAP models with the sidecar, wherever they come from."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.records import MapRecord, ModelEntry, TrackCounts, known_only
from semsfm_colmap.types import Float, Observations, SemSeries

if TYPE_CHECKING:
    from semsfm_colmap.colmap.database.work import DatabaseImage
    from semsfm_colmap.mapping.context import Guide
    from semsfm_colmap.mapping.finish import MappedPart

PERSPECTIVE_FOLDER = "perspective"
"""In a model's folder: the model with the perspective that was taken out, for COLMAP."""
TWIN_NOTE = "{}/1 holds the depth-reversed twin of {}/0"


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedSeries:
    """A series with what its database knows."""

    series: SemSeries
    keypoints: Mapping[str, Float]
    """(K, 2) px of each image, all of them: what the model's images hold"""
    database_images: Mapping[str, DatabaseImage]
    """the ids the model takes over"""
    observations: Observations
    counts: TrackCounts
    remarks: tuple[str, ...] = ()
    """what matching has noted: a cause, where there is no model"""


def map_series(
    matched: MatchedSeries,
    config: Config,
    reporter: Reporter,
    *,
    sparse_path: Path,
    image_path: Path | None,
    guide: Guide | None = None,
    write_guided: Callable[[Mapping[str, Float], Sequence[MappedPart]], None] | None = None,
) -> MapRecord:
    """Cameras and points into ``sparse_path/0`` (and the twin or further parts).

    Parameters
    ----------
    image_path : for the colours of the points; None leaves them grey
    guide, write_guided : the images for the guided pass, and where the keypoints it adds are put

    """
    from semsfm_colmap.ingest.series.tilt import recorded_displacements, tilt_prior
    from semsfm_colmap.mapping.context import PHASES, SeriesContext
    from semsfm_colmap.mapping.keypoints import append_keypoints
    from semsfm_colmap.mapping.merged import places_in, series_apart, series_notes
    from semsfm_colmap.mapping.parts import map_parts

    series, counts = matched.series, matched.counts
    several = len(series.series_names) > 1
    reporter.say(
        f"tracks: {counts.num_tracks} tracks, {len(matched.observations)} observations, "
        f"{counts.num_refused} contradictory matches refused"
    )
    context = SeriesContext(
        image_names=series.names,
        image_size_px=np.array([(frame.width_px, frame.height_px) for frame in series.frames]),
        factorization=config.factorization,
        refinement=config.refinement,
        pixel_size_um=series.pixel_size_um,
        pixel_size_source=series.pixel_size_source,
        tilt=None if several else tilt_prior(series, config.ingest),
        displacement_um=None if several else recorded_displacements(series),
        guide=guide,
        scanned=any(frame.scanned for frame in series.frames),
        series_idx=series.series_idx if several else None,
        seed=config.seed,
        say=reporter.detail,
    )
    with reporter.phases("map", PHASES) as progress:
        solution = map_parts(replace(context, progress=progress), matched.observations)
    if solution.value is None:
        raise InputError("; ".join((solution.message, *matched.remarks)))
    together = []
    if several:
        places = places_in(
            solution.value[0].reconstruction,
            series.names,
            series.series_idx,
            series.series_names,
            series.series_pixel_sizes_um,
        )
        apart = series_apart(places)
        if apart is not None:
            raise InputError(apart)
        together = series_notes(places, solution.value[0].figures.reliability.series)
    parts, keypoints = append_keypoints(solution.value, matched.keypoints)
    if write_guided is not None:
        write_guided(keypoints, parts)
    with reporter.progress("map: writing") as written:
        models = write_parts(
            parts,
            sparse_path,
            matched.database_images,
            keypoints,
            matched.keypoints,
            config,
            image_path,
            written,
        )
    figures, r = parts[0].figures, parts[0].reconstruction
    notes = (
        r.depth_sign.message,
        *together,
        *figures.notes,
        *part_notes(parts, models, series.names),
    )
    residuals = r.residuals()[r.inlier]
    rms_px = float(np.sqrt(np.mean(residuals**2)))
    reporter.say(
        f"map: {r.num_images} of {len(series.names)} images, {len(r.points)} points, residual "
        f"{rms_px:.3f} px RMS per coordinate"
    )
    for sentence in notes:
        reporter.say(sentence)
    return MapRecord(
        num_images=r.num_images,
        num_points=len(r.points),
        num_observations=int(r.inlier.sum()),
        rms_px=rms_px,
        tracks=counts,
        models=tuple(models),
        rounds=figures.rounds,
        reliability=figures.reliability,
        diagnostics=figures.diagnostics,
        notes=notes,
    )


def write_parts(
    parts: Sequence[MappedPart],
    sparse_path: Path,
    database_images: Mapping[str, DatabaseImage],
    keypoints: Mapping[str, Float],
    measured: Mapping[str, Float],
    config: Config,
    image_path: Path | None,
    progress: Callable[[int, int], None],
) -> list[ModelEntry]:
    """Write every part and its twin as a model of its own, numbered from 0; what was written.

    Parameters
    ----------
    keypoints, measured : of each image as the observations are, and as they were measured

    """
    from semsfm_colmap.colmap.model.colors import point_colors
    from semsfm_colmap.colmap.model.sparse import write_model, write_perspective_model

    models: list[ModelEntry] = []
    for k, part in enumerate(parts):
        progress(k, len(parts))
        color = None if image_path is None else point_colors(part.reconstruction, image_path)
        for kind, reconstruction in (("model", part.reconstruction), ("twin", part.twin)):
            if reconstruction is None:
                continue
            number = len(models)
            written = write_model(
                replace(reconstruction, point_color=color),
                sparse_path / str(number),
                database_images,
                keypoints,
                config.export,
                reliability=known_only(part.figures.reliability),
            )
            if part.view is not None and kind == "model" and part.view.kappa > 0.0:
                write_perspective_model(
                    replace(reconstruction, point_color=color),
                    part.view,
                    sparse_path / str(number) / PERSPECTIVE_FOLDER,
                    database_images,
                    measured,
                )
            models.append(
                ModelEntry(
                    model=f"{sparse_path.name}/{number}",
                    part=k,
                    kind="twin" if kind == "twin" else "model",
                    num_images=reconstruction.num_images,
                    images=reconstruction.image_names,
                    num_points=len(reconstruction.points),
                    focal_length_px=written.focal_length_px,
                    max_deviation_px=written.max_deviation_px,
                )
            )
    remove_stale_models(sparse_path, len(models))
    return models


def part_notes(
    parts: Sequence[MappedPart], models: Sequence[ModelEntry], names: Sequence[str]
) -> list[str]:
    """Sentences about the twin, about images left out, and about a series that fell apart."""
    notes = []
    if parts[0].twin is not None:
        folder = models[0].model.rsplit("/", 1)[0]
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
            + "; ".join(f"{m.model} ({m.num_images} images)" for m in models if m.kind == "model")
        )
    return notes


def own_models(sparse_path: Path) -> list[Path]:
    """The folders of models that a mapping has written; one without our sidecar is another's."""
    from semsfm_colmap.colmap.model.sidecar import FILE_NAME

    folders = sorted(sparse_path.iterdir()) if sparse_path.is_dir() else []
    return [f for f in folders if f.name.isdigit() and (f / FILE_NAME).is_file()]


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
