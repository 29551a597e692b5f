"""A textured mesh seen by the cameras again, correlated with the images.

The mesh of each project is textured, as an albedo and as an image. Normalised cross-correlation of
every image with what its camera sees of the mesh, texture times the shading that was fitted: over
all pixels that meet the mesh, over those that meet its outside, and over those of them that see it
at less than 60 degrees from its normal. Through holes and on sheets with one side only a camera
also sees the inside, of which no texture was made. d: the gradient of the shading; s: seconds of
the texture, without compiling.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import get_args, get_type_hints

import numpy as np

from benchmarks.tables import add_page_option, parser, put, table
from semsfm_colmap.io.grey import read_grey
from semsfm_colmap.io.open3d_rays import ray_scene, ray_tensor
from semsfm_colmap.io.ply import read_ply_mesh
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.surface.files import write_textured
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.shading import Shading
from semsfm_colmap.surface.stereo.undrift import drift_of, without_drift
from semsfm_colmap.surface.texture.atlas import texture_mesh
from semsfm_colmap.types import Array, Float, Int, OrthographicCameras, Reconstruction

COMMAND = "rerender"
MAX_SLANT_DEG = 60.0
"""Of the last pair of columns."""
MIN_SEEN_PX = 100
"""Images that see less of the mesh are not judged."""


@dataclass(frozen=True, kw_only=True)
class TexturedFile:
    """What a .glb holds, one vertex for each pair of place and texture coordinate."""

    vertices: Float
    faces: Int
    normals: Float
    uv: Float
    texture: Array


def correlations(
    glb: Path, shading: Shading, model: Reconstruction, image_path: Path
) -> tuple[Float, Float]:
    """NCC of each image with the mesh re-rendered, and the share of pixels that see its inside.

    The images are taken without their scan drift, as the model has none.

    Returns
    -------
    (M, 3) over all pixels, those that meet the outside, and those of them within 60 degrees; nan
    where there are too few. (M,) share

    """
    mesh = textured(glb)
    scene = ray_scene(mesh.vertices, mesh.faces)
    found = np.full((model.num_images, 3), np.nan)
    inside = np.full(model.num_images, np.nan)
    for i, name in enumerate(model.image_names):
        image = without_drift(
            read_grey(image_path / name).astype(np.float32), drift_of(model.drift_px, i)
        )
        hit, face, bary, flat = cast(scene, model.cameras, i, image.shape, mesh.vertices)
        if hit.sum() < MIN_SEEN_PX:
            continue
        facing = -(flat[hit] @ model.cameras.viewing_direction[i])
        corner = mesh.faces[face[hit]]
        weight = np.column_stack([1.0 - bary[hit].sum(axis=1), bary[hit]])
        uv = np.einsum("nk,nki->ni", weight, mesh.uv[corner])
        normal = np.einsum("nk,nki->ni", weight, mesh.normals[corner])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        normal *= np.where(facing > 0, 1.0, -1.0)[:, None]
        factor = shading.factor(i, normal @ model.cameras.cam_from_world[i].T)
        grey = factor * sampled(mesh.texture, uv)
        near = np.cos(np.radians(MAX_SLANT_DEG))
        for k, judged in enumerate((np.isfinite(facing), facing > 0, facing > near)):
            if judged.sum() >= MIN_SEEN_PX:
                found[i, k] = np.corrcoef(grey[judged], image[hit][judged])[0, 1]
        inside[i] = float(np.mean(facing <= 0))
    return found, inside


def textured(glb: Path) -> TexturedFile:
    """Read a textured mesh; the texture as grey."""
    import trimesh

    # without what the node says, which turns it for viewers
    (mesh,) = trimesh.load_scene(glb, process=False).geometry.values()
    picture = np.asarray(mesh.visual.material.baseColorTexture.convert("L"), dtype=np.float32)
    return TexturedFile(
        vertices=np.asarray(mesh.vertices, dtype=np.float64),
        faces=np.asarray(mesh.faces),
        normals=np.asarray(mesh.vertex_normals, dtype=np.float64),
        uv=np.asarray(mesh.visual.uv),
        texture=picture,
    )


def cast(
    scene: object, cameras: OrthographicCameras, i: int, shape: tuple[int, ...], vertices: Float
) -> tuple[Array, Array, Array, Array]:
    """Where pixels see the mesh: hit, face (H, W), barycentric (H, W, 2), normal (H, W, 3)."""
    height, width = shape
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    grid = np.stack([u, v], axis=-1).reshape(-1, 2)
    direction = cameras.viewing_direction[i]
    near = float((vertices @ direction).min()) - 1.0
    origin = (grid - cameras.translation_px[i]) @ np.linalg.pinv(cameras.projection[i]).T
    answer = scene.cast_rays(ray_tensor(origin + near * direction, direction))  # type: ignore[attr-defined]
    hit = np.isfinite(answer["t_hit"].numpy()).reshape(shape)
    face = answer["primitive_ids"].numpy().astype(np.int64).reshape(shape)
    bary = answer["primitive_uvs"].numpy().reshape(*shape, 2)
    normal = answer["primitive_normals"].numpy().reshape(*shape, 3)
    return hit, face, bary, normal


def sampled(texture: Array, uv: Float) -> Array:
    """Greys of a texture at coordinates (n, 2) with their origin at the bottom left."""
    import cv2

    height, width = texture.shape
    x = (uv[:, 0] * width - 0.5).astype(np.float32)
    y = ((1.0 - uv[:, 1]) * height - 0.5).astype(np.float32)
    rows = 1 << 14
    out = [
        cv2.remap(texture, x[k : k + rows, None], y[k : k + rows, None], cv2.INTER_LINEAR)[:, 0]
        for k in range(0, len(x), rows)
    ]
    return np.concatenate(out)


def one(path: Path, options: SurfaceOptions) -> list[object]:
    """The row of a project's mesh, textured anew."""
    project = Project(path)
    model = project.read_main_model()
    surface = read_ply_mesh(project.mesh / "mesh.ply")
    start = time.perf_counter()
    mesh, shading = texture_mesh(surface, model, project.images, options)
    seconds = time.perf_counter() - start
    with TemporaryDirectory() as folder:
        glb, _ = write_textured(mesh, folder)
        found, inside = correlations(glb, shading, model, project.images)
    cells: list[object] = [path.name, options.texture, model.num_images]
    for column in found.T:
        cells += [f"{np.nanmedian(column):.3f}", f"{np.nanmin(column):.3f}"]
    d = ", ".join(f"{v:+.2f}" for v in shading.gradient)
    return [*cells, f"{np.nanmean(inside):.1%}", d, f"{seconds:.1f}"]


def main() -> None:
    """Texture, measure and print."""
    p = parser(COMMAND, __doc__)
    p.add_argument("projects", nargs="+", type=Path, help="projects with mesh/mesh.ply")
    add_page_option(p, COMMAND)
    args = p.parse_args()
    kinds = get_args(get_type_hints(SurfaceOptions)["texture"])
    rows = [one(path, SurfaceOptions(texture=kind)) for path in args.projects for kind in kinds]
    names = ["project", "texture", "images", "NCC median", "worst", "outside: median", "worst"]
    names += [f"within {MAX_SLANT_DEG:.0f} deg: median", "worst", "inside seen", "d", "s"]
    text = table(names, rows)
    print(text)
    if args.markdown:
        put(args.markdown, COMMAND, text)


if __name__ == "__main__":
    main()
