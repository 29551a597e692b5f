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

    Maps that are in the folder are not made again.

    Parameters
    ----------
    title : of the progress

    """
    from semsfm_colmap.surface.files import depth_map_path, write_depth_map
    from semsfm_colmap.surface.stereo.depth_maps import sweep_depth_maps

    names = tuple(reconstruction.image_names[idx] for idx in references.tolist())
    missing = [not depth_map_path(folder, name).is_file() for name in names]
    num_done = len(names) - sum(missing)
    if num_done == len(names):
        return names
    with on.reporter.progress(title) as progress:
        for depth_map in sweep_depth_maps(
            reconstruction,
            references[missing],
            on.project.images,
            on.project.masks_or_none,
            on.config.surface,
            parallel_map=on.executor.map,
            num_at_a_time=on.executor.num_workers if on.executor.shares_memory else 1,
        ):
            write_depth_map(folder, depth_map)
            num_done += 1
            progress(num_done, len(names))
    return names
