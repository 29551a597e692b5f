"""images/, sparse/0 -> dense/depth_maps/, dense/fused.ply."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.atomic import folder_filled
from semsfm_colmap.io.layout import DENSE_FOLDER
from semsfm_colmap.pipeline.depth_maps import write_depth_maps
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.stage import Stage, StageRun, files_in
from semsfm_colmap.records import DensifyRecord


def run(on: StageRun) -> DensifyRecord:
    """Depth maps and their fusion.

    Where the depth maps agree on too little (few images, small angles) the fused cloud is the
    sparse one, and that is said.
    """
    import numpy as np

    from semsfm_colmap.io.ply import write_ply
    from semsfm_colmap.pipeline.stages.half_surfaces import compare_halves
    from semsfm_colmap.surface.build import fuse_depth_maps
    from semsfm_colmap.surface.files import DepthMapFolder
    from semsfm_colmap.surface.stereo.views import choose_references

    project, options = on.project, on.config.surface
    reconstruction = project.read_main_model()
    # the maps are written aside and replace those of an earlier run as a whole; those that a run
    # had made when it was cut off are kept
    folder = project.dense / "depth_maps"
    references = choose_references(
        reconstruction.cameras,
        options.max_num_depth_maps,
        np.radians(options.min_reference_angle_deg),
    )
    key = on.record.entry(STAGE.name).key
    with folder_filled(folder, key, fresh=on.fresh) as aside:
        names = write_depth_maps(on, reconstruction, references, aside, "depth maps")
    with on.reporter.progress("fusing") as progress:
        fused = fuse_depth_maps(
            DepthMapFolder(folder, names),
            reconstruction,
            project.images,
            options,
            progress=progress,
            parallel_map=on.executor.map,
        )
    if fused.value is None:
        raise InputError(fused.message)
    cloud = fused.value
    notes = (fused.message,) if fused.message else ()
    compared = None
    if options.half_series:
        compared = compare_halves(on, reconstruction)
        if compared is None:
            notes = (*notes, "half of the frames alone give no surface: there is none to compare")
    write_ply(project.dense / "fused.ply", cloud)
    on.reporter.say(f"densify: {len(names)} depth maps, {len(cloud.points)} points")
    for note in notes:
        on.reporter.say(note)
    return DensifyRecord(
        num_depth_maps=len(names),
        num_points=len(cloud.points),
        coverage=fused.diagnostics.get("coverage"),
        half_series=compared,
        notes=notes,
    )


def dense_files(project: Project) -> list[Path]:
    """The depth maps, and where the halves of the series differ."""
    from semsfm_colmap.pipeline.stages.half_surfaces import FILE_NAME

    return [*files_in(project.dense, FILE_NAME), *files_in(project.dense / "depth_maps")]


STAGE = Stage(
    name="densify",
    help="depth maps and their fusion",
    description="Depth maps by parallel-ray stereo, and their fusion.",
    sections=("surface",),
    outputs=lambda p: [p.dense / "fused.ply"],
    writes=dense_files,
    run=run,
    places=(DENSE_FOLDER,),
    optional=True,
)
