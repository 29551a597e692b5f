"""Depth maps of some images, written one by one as they are made."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from semsfm_colmap.pipeline.stage import StageRun

if TYPE_CHECKING:
    from semsfm_colmap.types import Int, Reconstruction


def write_depth_maps(
    on: StageRun, reconstruction: Reconstruction, references: Int, folder: Path, title: str
) -> tuple[str, ...]:
    """Sweep the references of a model into a folder: the names of their images, in order.

    Parameters
    ----------
    title : of the progress

    """
    from semsfm_colmap.surface.files import write_depth_map
    from semsfm_colmap.surface.stereo.depth_maps import sweep_depth_maps

    names: list[str] = []
    with on.reporter.progress(title) as progress:
        for depth_map in sweep_depth_maps(
            reconstruction,
            references,
            on.project.images,
            on.project.masks_or_none,
            on.config.surface,
            parallel_map=on.executor.map,
            num_at_a_time=on.executor.num_workers if on.executor.shares_memory else 1,
        ):
            write_depth_map(folder, depth_map)
            names.append(depth_map.image_name)
            progress(len(names), len(references))
    return tuple(names)
