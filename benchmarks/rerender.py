"""A textured mesh seen by the cameras again, correlated with the images.

For each project with a textured mesh: normalised cross-correlation of every image with what its
camera sees of the mesh: over all pixels that meet it, and over those that see it at less than 60
degrees from its normal. A texture has one grey a place; what it cannot follow is the shading that
changes with the view, most of all where surface is seen edge-on.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.tables import parser, table
from semsfm_colmap.io.grey import read_grey
from semsfm_colmap.io.open3d_rays import ray_scene, ray_tensor
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.surface.stereo.undrift import drift_of, without_drift
from semsfm_colmap.types import Array, Float, Int, OrthographicCameras, Reconstruction

COMMAND = "rerender"
MAX_SLANT_DEG = 60.0
"""Of the second pair of columns."""
MIN_SEEN_PX = 100
"""Images that see less of the mesh are not judged."""


def correlations(
    glb: Path, model: Reconstruction, image_path: Path, *, max_slant_deg: float = 90.0
) -> Float:
    """NCC of each image with the re-rendered mesh, over the pixels that see it: (M,) nan for none.

    The images are taken without their scan drift, as the model has none.

    Parameters
    ----------
    max_slant_deg : pixels that see the surface at a larger angle to its normal do not count

    """
    vertices, faces, uv, texture = textured(glb)
    scene = ray_scene(vertices, faces)
    found = np.full(model.num_images, np.nan)
    for i, name in enumerate(model.image_names):
        image = without_drift(
            read_grey(image_path / name).astype(np.float32), drift_of(model.drift_px, i)
        )
        hit, face, bary, normal = cast(scene, model.cameras, i, image.shape, vertices)
        if max_slant_deg < 90.0:
            cosine = np.abs(normal @ model.cameras.viewing_direction[i])
            hit = hit & (cosine > np.cos(np.radians(max_slant_deg)))
        if hit.sum() < MIN_SEEN_PX:
            continue
        corner = uv[faces[face[hit]]]
        at = corner[:, 0] + bary[hit, :1] * (corner[:, 1] - corner[:, 0])
        at = at + bary[hit, 1:] * (corner[:, 2] - corner[:, 0])
        found[i] = np.corrcoef(sampled(texture, at), image[hit])[0, 1]
    return found


def textured(glb: Path) -> tuple[Float, Int, Float, Array]:
    """Vertices, faces, texture coordinates of each vertex and the grey texture of a file."""
    import trimesh

    mesh = trimesh.load(glb, force="mesh", process=False)
    picture = np.asarray(mesh.visual.material.baseColorTexture.convert("L"), dtype=np.float32)
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    return vertices, np.asarray(mesh.faces), np.asarray(mesh.visual.uv), picture


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


def main() -> None:
    """Measure and print."""
    p = parser(COMMAND, __doc__)
    p.add_argument("projects", nargs="+", type=Path, help="projects with mesh/mesh.glb")
    args = p.parse_args()
    rows = []
    for path in args.projects:
        project = Project(path)
        model, glb = project.read_main_model(), project.mesh / "mesh.glb"
        cells: list[object] = [path.name, model.num_images]
        for slant in (90.0, MAX_SLANT_DEG):
            found = correlations(glb, model, project.images, max_slant_deg=slant)
            cells += [f"{np.nanmedian(found):.3f}", f"{np.nanmin(found):.3f}"]
        rows.append(cells)
    near = f"within {MAX_SLANT_DEG:.0f} deg"
    print(table(("project", "images", "NCC median", "worst", f"{near}: median", "worst"), rows))


if __name__ == "__main__":
    main()
