"""images/ -> keypoints and descriptors in database.db; resumes image by image."""

from __future__ import annotations

from dataclasses import replace
from statistics import median

from semsfm_colmap.io.layout import DATABASE_FILE
from semsfm_colmap.pipeline.stage import Stage, StageRun
from semsfm_colmap.records import ExtractRecord, OrientationTrial


def run(on: StageRun) -> ExtractRecord:
    """Find keypoints in all images that have none yet."""
    from semsfm_colmap.colmap.database.scratch import remove_database
    from semsfm_colmap.colmap.database.work import read_images, read_keypoints
    from semsfm_colmap.colmap.sift import extract_sift
    from semsfm_colmap.colmap.sift_apart import extract_sift_apart
    from semsfm_colmap.pipeline.stages.orientation import try_project_orientations
    from semsfm_colmap.pipeline.stages.own_features import extract_own, is_own

    project = on.project
    series = project.read_series()
    options, trial = on.config.features, None
    num_threads = on.local.num_workers
    if options.upright is None and len(series.names) > 2:
        with on.reporter.progress("upright or turned") as progress:
            trial = try_project_orientations(
                project,
                series,
                seed=on.config.seed,
                progress=progress,
                parallel_map=on.local.map,
            )
        options = replace(options, upright=trial.upright)
    if on.fresh:
        remove_database(project.database)
    with on.reporter.progress("features") as progress:
        if is_own(options):
            extract_own(on, series, options, progress=progress)
        elif not on.executor.shares_memory:
            extract_sift_apart(
                project.database,
                project.images,
                series.names,
                [(frame.width_px, frame.height_px) for frame in series.frames],
                options,
                mask_path=project.masks_or_none,
                parallel_map=on.executor.map,
                progress=progress,
            )
        else:
            extract_sift(
                project.database,
                project.images,
                series.names,
                [(frame.width_px, frame.height_px) for frame in series.frames],
                options,
                mask_path=project.masks_or_none,
                num_threads=num_threads,
                progress=progress,
            )
    images = read_images(project.database)
    keypoints = read_keypoints(project.database, [i.image_id for i in images])
    counts = [len(keypoints[i.image_id]) for i in images]
    on.reporter.say(
        f"features: {sum(counts)} keypoints, {int(median(counts))} an image (median), "
        + ("upright" if options.upright else "turned to their gradients")
    )
    return ExtractRecord(
        num_keypoints=dict(zip([i.name for i in images], counts, strict=True)),
        upright=bool(options.upright),
        orientation_trial=None
        if trial is None
        else OrientationTrial(near=trial.near, far=trial.far),
    )


STAGE = Stage(
    name="extract",
    help="read and prepare the images, find keypoints",
    description="Read and prepare the images of a folder, find keypoints in them.",
    sections=("features",),
    outputs=lambda p: [p.database],
    database_part="features",
    run=run,
    places=(DATABASE_FILE,),
)
