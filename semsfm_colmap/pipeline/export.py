"""Exporting a project's model, with its depth maps and cloud, to other programs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.registry import find_format
from semsfm_colmap.exports.scene import DenseView, ExportScene, Summary, read_scene
from semsfm_colmap.exports.write import export_scene
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Float, PointCloud, Reconstruction


def export_project(
    project_path: Path | str,
    format_name: str,
    output_path: Path | str | None = None,
    *,
    model: int = 0,
    options: FormatOptions | None = None,
) -> Summary:
    """Write a model of a project as another program reads it.

    Parameters
    ----------
    project_path : the project folder
    format_name : one of `semsfm_colmap.exports.registry.FORMATS`
    output_path : default PROJECT/export/<format>
    model : number of the model below sparse/
    options : focal length, names, dense settings

    Returns
    -------
    what was written and how far it is from parallel projection; the same is in export.json

    """
    options = options or FormatOptions()
    chosen = find_format(format_name)
    project = Project(Path(project_path))
    model_path = project.sparse / str(model)
    if not project.path.is_dir():
        raise UsageError(f"{project.path} is not a folder: give a project folder")
    if not model_path.is_dir():
        raise InputError(f"{model_path} does not exist: run `semsfm map` first")
    target = project.path / "export" / format_name if output_path is None else Path(output_path)
    scene = replace(
        read_scene(model_path, project.images, options, project.masks_or_none),
        database_path=project.database,
    )
    # the depth maps are those of the first model
    names = depth_map_names(project, scene.reconstruction) if model == 0 else []
    if chosen.uses_depth and names:
        scene = with_depth(scene, project, names)
    return export_scene(with_cloud(scene), format_name, target, options)


def depth_map_names(project: Project, reconstruction: Reconstruction) -> list[str]:
    """The images that have a depth map."""
    from semsfm_colmap.surface.files import depth_map_path

    folder = project.dense / "depth_maps"
    return [n for n in reconstruction.image_names if depth_map_path(folder, n).is_file()]


def with_depth(scene: ExportScene, project: Project, names: list[str]) -> ExportScene:
    """The scene with its depth maps, read one at a time."""
    return replace(
        scene,
        num_dense_views=len(names),
        dense_views=lambda: dense_views(
            scene.reconstruction, project.dense / "depth_maps", names, SurfaceOptions()
        ),
    )


def dense_views(
    reconstruction: Reconstruction, folder: Path, names: list[str], options: SurfaceOptions
) -> Iterator[DenseView]:
    """Depth maps with the slopes and normals of their local planes."""
    from semsfm_colmap.surface.depth_geometry import planes_and_normals
    from semsfm_colmap.surface.files import read_depth_map

    number = {name: i for i, name in enumerate(reconstruction.image_names)}
    for name in names:
        i = number[name]
        depth_map = read_depth_map(folder, name)
        size = reconstruction.image_size_px[i]
        planes, normals = planes_and_normals(
            reconstruction.cameras, i, size, depth_map, options.slope_radius_px
        )
        yield DenseView(
            image_idx=i,
            depth=depth_map.depth,
            slope=planes[1:],
            normal=normals,
            confidence=depth_map.confidence,
        )


def with_cloud(scene: ExportScene) -> ExportScene:
    """The scene with its oriented points and a PLY writer."""
    from semsfm_colmap.io.ply import write_ply

    return replace(scene, cloud=lambda: oriented_points(scene.reconstruction), write_ply=write_ply)


def oriented_points(reconstruction: Reconstruction) -> PointCloud:
    """The points with normals toward the viewers and standard deviations."""
    from semsfm_colmap.surface.fusion.cloud import sparse_cloud

    covariance = point_covariance(reconstruction)
    stored = reconstruction.point_covariance
    if stored is not None:
        known = np.isfinite(stored).all(axis=(1, 2), keepdims=True)
        covariance = np.where(known, stored, covariance)
    return sparse_cloud(replace(reconstruction, point_covariance=covariance), SurfaceOptions())


def point_covariance(reconstruction: Reconstruction) -> Float:
    """Covariance of each point with the cameras held fixed: (N, 3, 3), world units squared.

    ``C_j = sigma^2 (sum_o A_o^T A_o)^-1`` over the inlier observations of the point, A the linear
    part of its camera, ``sigma^2 = sum r^2 / (2 O - 3 N)`` from the residuals of all of them.
    """
    obs = reconstruction.observations.select(reconstruction.inlier)
    A = reconstruction.cameras.projection[obs.image_idx]
    H = np.zeros((len(reconstruction.points), 3, 3))
    np.add.at(H, obs.track_idx, np.einsum("oki,okj->oij", A, A))
    r = reconstruction.residuals()[reconstruction.inlier]
    freedom = max(2 * len(obs) - 3 * len(reconstruction.points), 1)
    variance = float(np.sum(r**2) / freedom)
    return np.asarray(variance * np.linalg.pinv(H, hermitian=True))
