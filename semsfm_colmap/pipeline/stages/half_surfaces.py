"""Two surfaces from disjoint halves of the frames, for the densify stage."""

from __future__ import annotations

from semsfm_colmap.io.temporary import temporary_folder
from semsfm_colmap.pipeline.depth_maps import write_depth_maps
from semsfm_colmap.pipeline.stage import StageRun
from semsfm_colmap.records import SurfaceHalves
from semsfm_colmap.types import PointCloud, Reconstruction

FILE_NAME = "half_series.ply"
MIN_IMAGES = 3
"""Fewer give no depth maps that could agree."""


def compare_halves(on: StageRun, reconstruction: Reconstruction) -> SurfaceHalves | None:
    """The surfaces of odd and even frames and dense/half_series.ply; None where one is empty."""
    from semsfm_colmap.surface.files import write_half_difference
    from semsfm_colmap.surface.half_series import (
        figures,
        fused_spacing,
        half_difference,
        halves,
        image_px,
        part_of,
    )

    path = on.project.dense / FILE_NAME
    path.unlink(missing_ok=True)
    parts = [part_of(reconstruction, part) for part in halves(reconstruction.num_images)]
    if min(part.num_images for part in parts) < MIN_IMAGES:
        return None
    odd, even = (half_surface(on, part) for part in parts)
    if len(odd.points) == 0 or len(even.points) == 0:
        return None
    found = half_difference(odd, even, fused_spacing(reconstruction, on.config.surface))
    said = figures(found, len(even.points), image_px(reconstruction))
    if said is not None:
        write_half_difference(path, found)
        on.reporter.say(
            f"densify: the surfaces of odd and even frames lie {said.robust_rms_px:.2f} px apart, "
            f"{said.ratio:.2f} of what their error bars say"
        )
    return said


def half_surface(on: StageRun, part: Reconstruction) -> PointCloud:
    """The fused cloud of some frames; their depth maps are not kept."""
    from semsfm_colmap.surface.files import DepthMapFolder
    from semsfm_colmap.surface.fusion.fuse import fuse
    from semsfm_colmap.surface.stereo.views import choose_references

    project, options = on.project, on.config.surface
    references = choose_references(part.cameras, options.max_num_depth_maps)
    with temporary_folder(project.dense) as folder:
        names = write_depth_maps(on, part, references, folder, "depth maps of half of the frames")
        with on.reporter.progress("fusing half of the frames") as progress:
            return fuse(
                DepthMapFolder(folder, names),
                part,
                project.images,
                options,
                progress=progress,
                parallel_map=on.executor.map,
            )
