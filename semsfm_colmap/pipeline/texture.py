"""The textured copies of a mesh beside it, where the libraries for that are there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from semsfm_colmap.errors import MissingDependencyError

if TYPE_CHECKING:
    from semsfm_colmap.surface.options import SurfaceOptions
    from semsfm_colmap.types import Reconstruction, TriangleMesh


TEXTURE_FILES = ("mesh.glb", "mesh.obj", "mesh.mtl", "material_0.png", "shading.json")
"""What it writes."""


def write_texture(
    surface: TriangleMesh,
    model: Reconstruction,
    image_path: Path,
    folder: Path,
    options: SurfaceOptions,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[str, ...]:
    """Write mesh.glb, mesh.obj and shading.json into a folder; what to say where that cannot be."""
    from semsfm_colmap.surface.files import write_shading, write_textured
    from semsfm_colmap.surface.texture.atlas import texture_mesh

    try:
        textured, shading = texture_mesh(surface, model, image_path, options, progress=progress)
        write_textured(textured, folder)
        write_shading(shading, model.image_names, folder / "shading.json")
    except (ImportError, MissingDependencyError) as error:
        return (f"the mesh was not textured: {error}",)
    return ()
