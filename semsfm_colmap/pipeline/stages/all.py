"""Each stage on a project folder: read what the one before left, compute, write.

A stage returns a summary for run.json; the report is made from these summaries and the files.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.config import Config
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord, versions
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.types import Float, Observations, Reconstruction, SemSeries

Summary = dict[str, Any]


def read_project_series(project: Project) -> SemSeries:
    """The prepared series of a project."""
    from semsfm_colmap.ingest.series.file import read_series

    return read_series(project.series)


def ingest(project: Project, image_path: Path, config: Config, reporter: Reporter) -> Summary:
    """Source images -> images/, masks/, series.json."""
    from semsfm_colmap.ingest.prepare import prepare_series

    with reporter.progress("reading images") as progress:
        series = prepare_series(image_path, project.path, config.ingest, progress=progress)
    for warning in series.warnings:
        reporter.warn(warning)
    reporter.say(
        f"{len(series.frames)} images, pixel size "
        + (
            f"{series.pixel_size_um:g} um ({series.pixel_size_source})"
            if series.pixel_size_um
            else "not known: lengths are in px"
        )
    )
    return {
        "num_images": len(series.frames),
        "pixel_size_um": series.pixel_size_um,
        "warnings": list(series.warnings),
    }


def extract(project: Project, config: Config, reporter: Reporter, *, fresh: bool) -> Summary:
    """images/ -> keypoints and descriptors in database.db; resumes image by image."""
    from semsfm_colmap.colmap.database.work import read_images, read_keypoints
    from semsfm_colmap.colmap.sift import extract_sift
    from semsfm_colmap.pipeline.orientation import try_orientations
    from semsfm_colmap.pipeline.stages.own_features import extract_own, is_own

    series = read_project_series(project)
    options, trial = config.features, None
    if options.upright is None and len(series.names) > 2:
        trial = try_orientations(project, series, num_threads=threads(config), seed=config.seed)
        options = replace(options, upright=trial.upright)
    if fresh:
        for suffix in ("", "-wal", "-shm"):
            project.database.with_name(project.database.name + suffix).unlink(missing_ok=True)
    with reporter.progress("features") as progress:
        if is_own(options):
            extract_own(project, series, options, num_threads=threads(config), progress=progress)
        else:
            extract_sift(
                project.database,
                project.images,
                series.names,
                [(frame.width_px, frame.height_px) for frame in series.frames],
                options,
                mask_path=project.masks_or_none,
                num_threads=threads(config),
                progress=progress,
            )
    images = read_images(project.database)
    keypoints = read_keypoints(project.database, [i.image_id for i in images])
    counts = [len(keypoints[i.image_id]) for i in images]
    reporter.say(
        f"features: {sum(counts)} keypoints, {int(np.median(counts))} an image (median), "
        + ("upright" if options.upright else "turned to their gradients")
    )
    return {
        "num_keypoints": dict(zip([i.name for i in images], counts, strict=True)),
        "upright": bool(options.upright),
        "orientation_trial": None if trial is None else asdict(trial),
    }


def threads(config: Config) -> int:
    """The number of threads asked for."""
    return config.num_threads if config.num_threads > 0 else (os.cpu_count() or 1)


def match(project: Project, config: Config, reporter: Reporter, *, fresh: bool) -> Summary:
    """Keypoints -> matches and two-view geometries in database.db; resumes pair by pair."""
    from semsfm_colmap.colmap.database.work import (
        clear_matches,
        read_images,
        read_keypoints,
        read_matches,
        write_two_view_geometries,
    )
    from semsfm_colmap.colmap.sift import match_sift
    from semsfm_colmap.matching.pairs import select_pairs
    from semsfm_colmap.matching.verify import verify_pair
    from semsfm_colmap.pipeline.stages.own_features import is_own, match_own
    from semsfm_colmap.pipeline.two_view import pair_statistics, stored_geometry

    series = read_project_series(project)
    if fresh:
        clear_matches(project.database)
    id_of = {image.name: image.image_id for image in read_images(project.database)}
    ids = [id_of[name] for name in series.names]
    pairs = select_pairs(len(ids), config.matching)
    with reporter.progress("matching pairs") as progress:
        if is_own(config.features):
            match_own(
                project,
                series.names,
                pairs,
                config,
                num_threads=threads(config),
                progress=progress,
            )
        else:
            id_pairs = [(ids[i], ids[j]) for i, j in pairs]
            match_sift(
                project.database,
                id_pairs,
                max_ratio=config.matching.max_ratio,
                num_threads=threads(config),
                progress=progress,
            )
    keypoints = read_keypoints(project.database, ids)
    raw = read_matches(project.database)
    jobs = []
    for i, j in pairs:
        a, b = ids[i], ids[j]
        rows = raw.get((a, b))
        if rows is None:
            rows = raw.get((b, a), np.zeros((0, 2), dtype=np.int64))[:, ::-1]
        jobs.append((i, j, rows))
    with (
        reporter.progress("verifying pairs") as progress,
        ThreadPoolExecutor(threads(config)) as pool,
    ):
        geometries = []
        for geometry in pool.map(
            lambda job: verify_pair(
                (job[0], job[1]),
                keypoints[ids[job[0]]],
                keypoints[ids[job[1]]],
                job[2],
                config.matching,
                config.seed,
            ),
            jobs,
        ):
            geometries.append(geometry)
            progress(len(geometries), len(jobs))
    stored = dict(stored_geometry(g, ids) for g in geometries)
    statistics = pair_statistics(geometries, series.names)
    write_two_view_geometries(project.database, stored)
    verified = [g for g in geometries if g.F is not None]
    reporter.say(
        f"matching: {len(verified)} of {len(pairs)} pairs verified, "
        f"{sum(int(g.inlier.sum()) for g in verified)} matches"
    )
    return {"num_pairs": len(pairs), "num_verified_pairs": len(verified), "pairs": statistics}


def build_observations(
    project: Project,
    config: Config,
    names: tuple[str, ...],
    num_measured: Mapping[str, int] | None = None,
) -> tuple[Observations, dict[str, int], dict[str, Float]]:
    """Verified matches of the database -> Observations, counts of the joining, keypoints by name.

    Parameters
    ----------
    num_measured : how many of each image's keypoints were extracted; those after them were added by
        an earlier guided pass and are left out

    """
    from semsfm_colmap.colmap.database.work import read_images, read_inlier_matches, read_keypoints
    from semsfm_colmap.pipeline.stages.sparse_models import join_matches

    id_of = {image.name: image.image_id for image in read_images(project.database)}
    ids = [id_of[name] for name in names]
    number = {image_id: i for i, image_id in enumerate(ids)}
    stored = read_keypoints(project.database, ids)
    measured = num_measured or {}
    keypoints = [stored[k][: measured.get(name)] for k, name in zip(ids, names, strict=True)]
    matches = {}
    for (a, b), rows in read_inlier_matches(project.database).items():
        if a in number and b in number:
            i, j = number[a], number[b]
            known = (rows[:, 0] < len(keypoints[i])) & (rows[:, 1] < len(keypoints[j]))
            matches[i, j] = rows[known]
    observations, counts = join_matches(keypoints, matches, config)
    return observations, counts, dict(zip(names, keypoints, strict=True))


def map_(project: Project, config: Config, reporter: Reporter, record: RunRecord) -> Summary:
    """Verified matches -> sparse/0 (and the twin or further parts); guided matches -> database."""
    from semsfm_colmap.colmap.database.work import read_images
    from semsfm_colmap.mapping.guided import guide_from_folders
    from semsfm_colmap.pipeline.stages.guided_database import write_guided
    from semsfm_colmap.pipeline.stages.sparse_models import map_series

    series = read_project_series(project)
    measured = record.stages.get("extract", {}).get("summary", {}).get("num_keypoints", {})
    observations, counts, keypoints = build_observations(project, config, series.names, measured)
    images = {image.name: image for image in read_images(project.database)}
    return map_series(
        series,
        keypoints,
        images,
        observations,
        counts,
        config,
        reporter,
        sparse_path=project.sparse,
        image_path=project.images,
        guide=guide_from_folders(project.images, project.masks_or_none, keypoints, config.guided),
        write_guided=lambda extended, parts: write_guided(
            project.database, images, keypoints, extended, parts, config.matching.min_num_inliers
        ),
    )


def read_main_model(project: Project) -> Reconstruction:
    """The first model of a project."""
    from semsfm_colmap.colmap.model.sparse import read_model

    return read_model(project.sparse / "0")


def report(project: Project, record: RunRecord, reporter: Reporter) -> Summary:
    """Everything known -> report/."""
    from semsfm_colmap.io.ply import read_ply_cloud, read_ply_mesh
    from semsfm_colmap.report.inputs import PairStatistics, ReportInputs
    from semsfm_colmap.report.write import write_report

    series = read_project_series(project)
    reconstruction = read_main_model(project)
    mapping = record.stages.get("map", {}).get("summary", {})
    pairs = record.stages.get("match", {}).get("summary", {}).get("pairs", [])
    # the report says itself what the series and the verdict on the hand say
    notes = [
        note
        for stage in record.stages.values()
        for note in stage.get("summary", {}).get("notes", [])
        if note != reconstruction.depth_sign.message
    ]
    mesh_file, cloud_file = project.mesh / "mesh.ply", project.dense / "fused.ply"
    models = mapping.get("models", [])
    rounds = mapping.get("rounds", [])
    inputs = ReportInputs(
        reconstruction=reconstruction,
        series=series,
        pairs=tuple(PairStatistics(**p) for p in pairs),
        stage_times={
            name: stage["seconds"] for name, stage in record.stages.items() if name != "report"
        },
        stage_peak_memory_mb={
            name: stage["peak_memory_mb"]
            for name, stage in record.stages.items()
            if name != "report"
        },
        notes=tuple(dict.fromkeys(notes)),
        filtering_rounds=tuple(filtering_rounds(rounds)),
        guided=mapping.get("diagnostics", {}).get("guided", {}),
        reliability=mapping.get("reliability", {}),
        mesh=read_ply_mesh(mesh_file) if mesh_file.is_file() else None,
        cloud=read_ply_cloud(cloud_file) if cloud_file.is_file() else None,
        versions=versions(),
        twin_written=any(m["kind"] == "twin" and m["part"] == 0 for m in models),
        telecentric={
            "focal_length_px": models[0]["focal_length_px"],
            "max_deviation_px": models[0]["max_deviation_px"],
        }
        if models
        else {},
        title=project.path.resolve().name,
    )
    metrics = write_report(inputs, project.report)
    reporter.say(f"report: {project.report / 'report.html'}")
    return {"num_metrics": len(metrics)}


def filtering_rounds(rounds: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rounds as the report wants them: kept and dropped observations of each."""
    result = []
    before: int | None = None
    for r in rounds:
        kept = int(r["num_observations"])
        dropped = 0 if before is None else max(before - kept, 0)
        result.append({**r, "num_kept": kept, "num_dropped": dropped})
        before = kept
    return result
