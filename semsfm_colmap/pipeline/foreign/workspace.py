"""A COLMAP folder as its users have it: which model is meant, and what lies beside it.

Looked at, in this order: ``sparse/``, with the model in it or in ``0``, ``1``, ...; the folder
itself, as a model or as a mapper's output with 0, 1, ...; ``dense/``, ``dense/sparse`` and
``dense/0/sparse``. Of several components the one with most images is meant. A dense workspace is
the folder itself, ``dense/`` or ``dense/<number>`` with ``stereo/`` or ``fused.ply`` in it; its own
``sparse/`` holds the cameras of its maps, which are those of the undistorted images. It belongs to
the model when it has most of its images.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.errors import InputError, UsageError

MAP_KINDS = ("geometric", "photometric")
"""Maps of patch-match stereo: the first that is there counts."""


@dataclass(frozen=True, kw_only=True)
class Workspace:
    """The parts of a COLMAP folder that a mesh is made from."""

    path: Path
    model_path: Path
    """Folder of the sparse model"""
    other_models: tuple[Path, ...] = ()
    """Components that are not meant"""
    fused_path: Path | None = None
    """fused.ply"""
    dense_path: Path | None = None
    """Folder with stereo/depth_maps"""
    image_path: Path | None = None
    """Folder of images"""

    @property
    def maps_model_path(self) -> Path:
        """The model whose cameras the depth maps were made with."""
        own = None if self.dense_path is None else _first_model(self.dense_path)
        return own or self.model_path

    def depth_map(self, name: str) -> Path | None:
        """The depth map of an image."""
        return self._map("depth_maps", name)

    def normal_map(self, name: str) -> Path | None:
        """The normal map of an image."""
        return self._map("normal_maps", name)

    def _map(self, folder: str, name: str) -> Path | None:
        if self.dense_path is None:
            return None
        stem = self.dense_path / "stereo" / folder
        paths = (stem / f"{name}.{kind}.bin" for kind in MAP_KINDS)
        return next((path for path in paths if path.is_file()), None)


def find_workspace(
    colmap_path: Path, sparse_path: Path | None = None, image_path: Path | None = None
) -> Workspace:
    """Find the model of a COLMAP folder and what lies beside it; nothing is written.

    Raises
    ------
    UsageError
        A path is not a folder.
    InputError
        There is no model.

    """
    for path, flag in (
        (colmap_path, "--colmap_path"),
        (sparse_path, "--sparse_path"),
        (image_path, "--image_path"),
    ):
        if path is not None and not path.is_dir():
            raise UsageError(f"{path} is not a folder: give a folder as {flag}")
    models = _models(sparse_path) if sparse_path is not None else _workspace_models(colmap_path)
    if not models:
        place = sparse_path or colmap_path
        raise InputError(
            f"{place} holds no COLMAP model: looked for points3D.bin and points3D.txt in it, in "
            "sparse/, sparse/0, ..., dense/sparse and dense/0/sparse; give the folder of the model "
            "as --sparse_path"
        )
    chosen = _largest(models)
    dense = _dense_folder(colmap_path, chosen)
    if image_path is None:
        image_path = next(
            (
                folder / "images"
                for folder in (colmap_path, dense)
                if folder is not None and (folder / "images").is_dir()
            ),
            None,
        )
    stereo = dense if dense is not None and (dense / "stereo" / "depth_maps").is_dir() else None
    fused = None if dense is None else dense / "fused.ply"
    return Workspace(
        path=colmap_path,
        model_path=chosen,
        other_models=tuple(model for model in models if model != chosen),
        fused_path=fused if fused is not None and fused.is_file() else None,
        dense_path=stereo,
        image_path=image_path,
    )


def find_model(path: Path) -> Path:
    """The model that a path means: the folder itself, else the largest where users have it.

    Raises
    ------
    InputError
        There is none.

    """
    models = _models(path) or _workspace_models(path)
    if not models:
        raise InputError(
            f"{path} holds no COLMAP model: give the folder with points3D.bin or .txt, or one with "
            "sparse/ in it"
        )
    return _largest(models)


def _numbered(folder: Path) -> Iterator[Path]:
    """Folders named by numbers, in their order."""
    if folder.is_dir():
        yield from sorted(
            (p for p in folder.iterdir() if p.is_dir() and p.name.isdecimal()),
            key=lambda p: int(p.name),
        )


def _models(folder: Path) -> list[Path]:
    """The folder itself when it is a model, else its numbered components."""
    from semsfm_colmap.colmap.model.any_model import holds_model

    if holds_model(folder):
        return [folder]
    return [path for path in _numbered(folder) if holds_model(path)]


def _workspace_models(path: Path) -> list[Path]:
    places = [path / "sparse", path, path / "dense", path / "dense" / "sparse"]
    places += [dense / "sparse" for dense in _numbered(path / "dense")]
    return next((models for models in map(_models, places) if models), [])


def _first_model(folder: Path) -> Path | None:
    models = _models(folder / "sparse")
    return models[0] if models else None


def _largest(models: list[Path]) -> Path:
    """The component with most images, then most points."""
    from semsfm_colmap.colmap.model.any_model import model_size

    if len(models) == 1:
        return models[0]
    return max(models, key=lambda path: (*model_size(path), -models.index(path)))


def _dense_folder(path: Path, model: Path) -> Path | None:
    """The dense workspace of a model: of several the one of the same number."""
    dense = list(_numbered(path / "dense"))
    same = [folder for folder in dense if folder.name == model.name]
    # a model named by --sparse_path may lie in a workspace of its own
    inside = model.resolve().is_relative_to(path.resolve())
    parents = [] if inside else [model.parent, model.parent.parent]
    for folder in (path, path / "dense", *(same or dense), *parents):
        maps, fused = folder / "stereo" / "depth_maps", folder / "fused.ply"
        if (maps.is_dir() or fused.is_file()) and _belongs(folder, model):
            return folder
    return None


def _belongs(dense: Path, model: Path) -> bool:
    """Whether a dense workspace has most of a model's images, as far as it says so."""
    from semsfm_colmap.colmap.model.any_model import image_names

    own = _first_model(dense)
    if own is None or own == model:
        return True
    names = image_names(model)
    return 2 * len(names & image_names(own)) > len(names)
