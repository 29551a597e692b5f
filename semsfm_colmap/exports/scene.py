"""What every exporter is handed: a model with its keypoints, images and depth maps."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from semsfm_colmap.colmap.model.rows import model_rows
from semsfm_colmap.colmap.model.sidecar import FILE_NAME, read_sidecar
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.errors import InputError
from semsfm_colmap.exports.dense import DenseView, dense_views
from semsfm_colmap.exports.names import plain_names
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.surface.files import depth_map_path
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Float, Reconstruction, SemSeries

Summary = dict[str, Any]
"""What an exporter says about what it wrote; goes into export.json."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportScene:
    """A sparse model and what lies beside it."""

    reconstruction: Reconstruction
    names: tuple[str, ...]
    """Image names in the export, the project's own unless plain ones were asked for"""
    image_ids: tuple[int, ...]
    """COLMAP's image ids"""
    keypoints: tuple[Float, ...]
    """(K, 2) px of each image, all of them"""
    focal_length_px: float
    """The focal length of the project's own sparse model"""
    image_path: Path
    """Folder of the project's images"""
    mask_path: Path | None = None
    """Folder of masks in COLMAP's convention"""
    database_path: Path | None = None
    """The project's database"""
    depth_map_path: Path | None = None
    """Folder of the project's depth maps"""
    mesh_path: Path | None = None
    """The project's mesh.ply"""
    made: Mapping[Path, str] = field(default_factory=dict)
    """Depth maps and masks that the project has made, each with the command that makes it again"""
    tilt_rad: Float | None = None
    """(M,) recorded tilts, nan where none is; None: nothing is known of them"""

    @property
    def size_px(self) -> int:
        """The longest side of an image."""
        return int(self.reconstruction.image_size_px.max())

    @property
    def depth_map_names(self) -> list[str]:
        """The images that have a depth map."""
        folder = self.depth_map_path
        if folder is None:
            return []
        self.check_made(folder)
        return [n for n in self.reconstruction.image_names if depth_map_path(folder, n).is_file()]

    def check_made(self, folder: Path) -> None:
        """Refuse to leave out in silence what was made in a folder and is not there any more."""
        for path, command in self.made.items():
            if path.is_relative_to(folder) and not (path.is_file() and path.stat().st_size):
                raise InputError(f"{path} is missing or empty: run `{command}` first")

    def dense_views(self) -> Iterator[DenseView]:
        """The depth maps, one at a time."""
        names = self.depth_map_names
        if self.depth_map_path is not None and names:
            yield from dense_views(
                self.reconstruction, self.depth_map_path, names, SurfaceOptions()
            )

    def copy_images(self, folder: Path, *, rgb: bool = False) -> None:
        """Copy the registered images under their names in the export.

        Parameters
        ----------
        rgb : grey ones as three equal channels, for programs that take the first three of each row
            of an image's last axis, and of a grey one the first three columns

        """
        for source, name in zip(self.reconstruction.image_names, self.names, strict=True):
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                if rgb:
                    _copy_as_rgb(self.image_path / source, target)
                else:
                    shutil.copyfile(self.image_path / source, target)
            except FileNotFoundError:
                raise InputError(
                    f"{self.image_path / source} is missing: the export needs the prepared images; "
                    "run `semsfm extract` again"
                ) from None

    def copy_masks(self, folder: Path) -> int:
        """Copy the masks as ``<name>.png``; returns how many there are."""
        if self.mask_path is None:
            return 0
        self.check_made(self.mask_path)
        count = 0
        for source, name in zip(self.reconstruction.image_names, self.names, strict=True):
            mask = self.mask_path / f"{source}.png"
            if mask.is_file():
                target = folder / f"{name}.png"
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(mask, target)
                count += 1
        return count


def _copy_as_rgb(source: Path, target: Path) -> None:
    """Copy an image, a grey one as three equal channels in the same format without loss."""
    from PIL import Image

    with Image.open(source) as image:
        if image.mode == "RGB":
            shutil.copyfile(source, target)
            return
        kept = {"quality": 100, "subsampling": 0} if image.format == "JPEG" else {}
        image.convert("RGB").save(target, format=image.format, **kept)


def read_scene(
    model_path: Path,
    image_path: Path,
    options: FormatOptions,
    *,
    mask_path: Path | None = None,
    database_path: Path | None = None,
    depth_map_path: Path | None = None,
    mesh_path: Path | None = None,
    series: SemSeries | None = None,
    made: Mapping[Path, str] | None = None,
) -> ExportScene:
    """Read a model that has its sidecar, and remember where what belongs to it lies.

    Parameters
    ----------
    series : tells the recorded tilts
    made : depth maps and masks that must be there, see `ExportScene`

    """
    reconstruction = read_model(model_path)
    sidecar = read_sidecar(model_path / FILE_NAME)
    rows = model_rows(model_path)
    names = reconstruction.image_names
    return ExportScene(
        reconstruction=reconstruction,
        names=plain_names(names) if options.plain_names else names,
        image_ids=tuple(rows[name].image_id for name in names),
        keypoints=tuple(rows[name].keypoints for name in names),
        focal_length_px=float(sidecar["telecentric"]["focal_length_px"]),
        image_path=image_path,
        mask_path=mask_path,
        database_path=database_path,
        depth_map_path=depth_map_path,
        mesh_path=mesh_path,
        made=made or {},
        tilt_rad=None if series is None else series.recorded("tilt_rad", names),
    )
