"""The cloud that a COLMAP folder is meshed from: where it comes from and what its sigma holds.

The best of what is there is taken: fused.ply, else the depth maps of patch-match stereo, else the
images of a model of parallel projection, from which depth maps are made as `semsfm densify` does,
else the sparse points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.layout import MASKS_FOLDER
from semsfm_colmap.pipeline.foreign.workspace import Workspace
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import PointCloud

if TYPE_CHECKING:
    from semsfm_colmap.colmap.model.any_model import AnyModel
    from semsfm_colmap.surface.depth_view import DepthView
    from semsfm_colmap.types import Float, Reconstruction

MIN_STEREO_IMAGES = 3
"""Two parallel views do not fix a shape."""
SIGMA_OF_CLOUD = "as in fused.ply"
SIGMA_OF_MAPS = "a lower bound: the spread of the depth maps that agree"
SIGMA_OF_STEREO = "as of `semsfm densify`"
SIGMA_OF_STEREO_ALONE = "as of `semsfm densify`, without the cameras' part: the model tells none"
SIGMA_OF_POINTS = "a lower bound: that of the triangulation, the cameras exact"
NO_SIGMA = "none: fused.ply tells of no errors, and no depth maps lie beside it"


@dataclass(frozen=True, kw_only=True, eq=False)
class Source:
    """The cloud that is meshed, where it came from, and depth maps of the same surface."""

    kind: str
    sigma: str
    """What the cloud's sigma holds"""
    cloud: PointCloud
    views: Sequence[DepthView] = ()
    notes: tuple[str, ...] = ()


def all_there(images: Path, model: Reconstruction) -> bool:
    """Whether a folder has all images of a model."""
    return all((images / name).is_file() for name in model.image_names)


def read_source(
    workspace: Workspace,
    parallel: Reconstruction | None,
    options: SurfaceOptions,
    reporter: Reporter,
) -> Source:
    """The best cloud that the folder gives.

    Parameters
    ----------
    parallel : the model with orthographic cameras, where its projection is parallel

    """
    from semsfm_colmap.colmap.model.any_model import read_any_model
    from semsfm_colmap.colmap.model.point_covariance import point_covariances
    from semsfm_colmap.geometry.normals import mean_direction_from
    from semsfm_colmap.surface.foreign_cloud import cloud_of_views, viewed_cloud

    model = read_any_model(workspace.model_path, workspace.image_path)
    directions = mean_direction_from(
        model.centres, model.points, model.observation_image, model.observation_point
    )
    seen = np.linalg.norm(directions, axis=1) > 0
    views, notes = depth_views(workspace, options)
    if workspace.fused_path is not None:
        return fused_source(
            workspace.fused_path, model.points[seen], directions[seen], views, options
        )
    if len(views) >= 2:
        return Source(
            kind=f"{len(views)} depth maps",
            sigma=SIGMA_OF_MAPS,
            cloud=cloud_of_views(views, options),
            views=views,
            notes=notes,
        )
    own, own_notes = parallel_source(workspace, parallel, options, reporter)
    if own is not None:
        return own
    two_views = model.num_images == 2
    if two_views and parallel is not None:
        raise InputError(
            f"{workspace.model_path} has two images under parallel projection, which leave a "
            "one-parameter family of shapes: a third image is needed"
        )
    length = min(options.min_track_length, 2 if two_views else options.min_track_length)
    keep = seen & (model.track_length() >= length)
    if two_views:
        notes = (*notes, "two images: what they see is not checked by a third one")
    return Source(
        kind="sparse points",
        sigma=SIGMA_OF_POINTS,
        cloud=viewed_cloud(
            model.points[keep],
            directions[keep],
            model.colors[keep],
            options,
            point_covariances(model)[keep],
        ),
        notes=(*notes, *own_notes),
    )


def fused_source(
    path: Path,
    points: Float,
    directions: Float,
    views: Sequence[DepthView],
    options: SurfaceOptions,
) -> Source:
    """A fused cloud, with normals and error bars as far as they can be had.

    Parameters
    ----------
    points, directions : (S, 3) sparse points and where they were seen from
    views : depth maps beside it

    """
    from semsfm_colmap.io.ply import read_ply_cloud
    from semsfm_colmap.surface.foreign_cloud import orient_cloud, with_spread

    cloud = orient_cloud(read_ply_cloud(path), points, directions, options)
    sigma = SIGMA_OF_CLOUD
    if cloud.sigma is None:
        cloud = with_spread(cloud, views, options)
        sigma = NO_SIGMA if cloud.sigma is None else SIGMA_OF_MAPS
    return Source(kind="fused.ply", sigma=sigma, cloud=cloud, views=views)


def depth_views(
    workspace: Workspace, options: SurfaceOptions
) -> tuple[Sequence[DepthView], tuple[str, ...]]:
    """The depth maps of a dense workspace as views, and what is to be said of them."""
    if workspace.dense_path is None:
        return (), ()
    from semsfm_colmap.colmap.model.any_model import read_any_model

    model = read_any_model(workspace.maps_model_path)
    rows = [i for i, name in enumerate(model.image_names) if workspace.depth_map(name) is not None]
    distorted = [i for i in rows if not np.isfinite(model.matrix[i]).all()]
    if distorted:
        name = model.image_names[distorted[0]]
        raise InputError(
            f"{workspace.dense_path} has depth maps, but {workspace.maps_model_path} has the image "
            f"{name} with distortion ({model.camera_models[distorted[0]]}): give the model of the "
            "undistorted images, which `colmap image_undistorter` writes to sparse/ beside stereo/"
        )
    if not rows:
        return (), (
            f"{workspace.dense_path} has no depth maps of the images of the model: run "
            "`colmap patch_match_stereo` for a denser surface",
        )
    chosen = np.unique(
        np.linspace(0, len(rows) - 1, min(len(rows), options.max_num_depth_maps)).astype(int)
    )
    size = options.max_depth_map_size_px
    return [depth_view(workspace, model, rows[k], size) for k in chosen.tolist()], ()


def depth_view(workspace: Workspace, model: AnyModel, image_idx: int, max_size: int) -> DepthView:
    """The maps of an image with its camera and, where its image is there, its colours."""
    from semsfm_colmap.colmap.dense_map import read_map
    from semsfm_colmap.io.color import read_color
    from semsfm_colmap.surface.depth_view import pinhole_view

    name = model.image_names[image_idx]
    depth_path, normal_path = workspace.depth_map(name), workspace.normal_map(name)
    assert depth_path is not None
    assert workspace.dense_path is not None
    return pinhole_view(
        read_map(depth_path),
        model.matrix[image_idx],
        model.cam_from_world[image_idx],
        model.image_size_px[image_idx],
        normals=None if normal_path is None else read_map(normal_path),
        colors=read_color(workspace.dense_path / "images" / name),
        max_size_px=max_size,
    )


def parallel_model(workspace: Workspace) -> Reconstruction | None:
    """The model with orthographic cameras, None when its projection is not parallel."""
    from semsfm_colmap.colmap.model.pinhole_reading import read_pinhole_model
    from semsfm_colmap.colmap.model.sidecar import FILE_NAME
    from semsfm_colmap.colmap.model.sparse import read_model

    if (workspace.model_path / FILE_NAME).is_file():
        return read_model(workspace.model_path)
    try:
        return read_pinhole_model(workspace.model_path).reconstruction
    except InputError:
        return None


def parallel_source(
    workspace: Workspace,
    model: Reconstruction | None,
    options: SurfaceOptions,
    reporter: Reporter,
) -> tuple[Source | None, tuple[str, ...]]:
    """Depth maps of our own where the projection is parallel and all the images are there.

    Where there are none, or they agree on too little, there is no source, and what is to be said.
    """
    from semsfm_colmap.pipeline.executor import ThreadExecutor
    from semsfm_colmap.surface.build import fuse_depth_maps
    from semsfm_colmap.surface.depth_view import parallel_view
    from semsfm_colmap.surface.stereo.depth_maps import sweep_depth_maps
    from semsfm_colmap.surface.stereo.views import choose_references

    images = workspace.image_path
    if model is None or model.num_images < MIN_STEREO_IMAGES or images is None:
        return None, ()
    if not all_there(images, model):
        return None, ()
    masks = workspace.path / MASKS_FOLDER
    references = choose_references(
        model.cameras, options.max_num_depth_maps, np.radians(options.min_reference_angle_deg)
    )
    executor = ThreadExecutor(-1)
    maps = []
    with reporter.progress("depth maps") as progress:
        for depth_map in sweep_depth_maps(
            model,
            references,
            images,
            masks if masks.is_dir() else None,
            options,
            parallel_map=executor.map,
            num_at_a_time=executor.num_workers,
        ):
            maps.append(depth_map)
            progress(len(maps), len(references))
    fused = fuse_depth_maps(maps, model, images, options, parallel_map=executor.map)
    notes = (fused.message,) if fused.message else ()
    if fused.value is None or fused.status == "sparse":
        return None, notes
    number = {name: i for i, name in enumerate(model.image_names)}
    views = [
        parallel_view(
            model.cameras, number[m.image_name], model.image_size_px[number[m.image_name]], m
        )
        for m in maps
    ]
    source = Source(
        kind=f"{len(maps)} depth maps of our own",
        sigma=SIGMA_OF_STEREO_ALONE if model.point_covariance is None else SIGMA_OF_STEREO,
        cloud=fused.value,
        views=views,
        notes=notes,
    )
    return source, notes
