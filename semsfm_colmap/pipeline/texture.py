"""The textured copies of a mesh beside it, where the libraries for that are there."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from semsfm_colmap.errors import MissingDependencyError

if TYPE_CHECKING:
    from semsfm_colmap.surface.options import SurfaceOptions
    from semsfm_colmap.types import Reconstruction, TriangleMesh


def write_texture(
    surface: TriangleMesh,
    model: Reconstruction,
    image_path: Path,
    folder: Path,
    options: SurfaceOptions,
) -> tuple[str, ...]:
    """Write mesh.glb and mesh.obj into a folder; what is to be said where that cannot be."""
    from semsfm_colmap.surface.files import write_textured
    from semsfm_colmap.surface.texture.atlas import texture_mesh

    try:
        write_textured(texture_mesh(surface, model, image_path, options), folder)
    except (ImportError, MissingDependencyError) as error:
        return (f"the mesh was not textured: {error}",)
    return ()
