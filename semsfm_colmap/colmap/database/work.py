"""COLMAP's database.db, the working store: images, keypoints, matches, two-view geometries."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.colmap.database.checks import check_writable, database_sentence
from semsfm_colmap.colmap.library import pycolmap, without_log_lines
from semsfm_colmap.errors import InputError
from semsfm_colmap.io.disk import full_disk_is_said, require_space
from semsfm_colmap.io.names import check_names
from semsfm_colmap.types import Array, Float, Int

TRANSACTION_BYTES = 1 << 18
"""For the log and its index, the pages of the tables' trees, and those that are freed."""
ROW_BYTES = 1 << 14
"""What a row may take beside its data: its own pages and those of the indices, in both files."""
INDEX_BYTES = 4
GEOMETRY_BYTES = 1024
"""Matrices and poses of a two-view geometry."""

ImagePair = tuple[int, int]
"""COLMAP image ids, the smaller one first."""


@dataclass(frozen=True, kw_only=True)
class DatabaseImage:
    """A row of the images table."""

    image_id: int
    name: str
    camera_id: int


@contextmanager
def open_database(path: Path, *, create: bool = False) -> Iterator[Any]:
    """Open the working database; one sentence when it is missing, held, too new or not one.

    pycolmap writes to every database it opens (tables, version), even to read from it; another's
    database is read with `colmap.database.reader` instead.
    """
    if path.exists() and path.stat().st_size > 0:
        check_writable(path, unfinished=create)
    elif not create:
        raise InputError(f"{path} does not exist: run `semsfm extract` first")
    with full_disk_is_said(path.parent):
        try:
            with without_log_lines():  # what it says there, the error says
                database = pycolmap.Database.open(str(path))
        except RuntimeError as error:
            raise InputError(database_sentence(path, error)) from error
        try:
            yield database
        except RuntimeError as error:
            raise InputError(database_sentence(path, error)) from error
        finally:
            database.close()


@contextmanager
def transaction(database: Any, path: Path, num_rows: int, num_bytes: int) -> Iterator[None]:
    """A transaction for which there is space: a commit that fails ends the process in pycolmap.

    Parameters
    ----------
    num_rows, num_bytes : that are written, at most; they go to the log first, then to the file

    """
    require_space(path, TRANSACTION_BYTES + 2 * num_bytes + ROW_BYTES * num_rows)
    with pycolmap.DatabaseTransaction(database):
        yield


def read_images(path: Path) -> list[DatabaseImage]:
    """All images, by id."""
    with open_database(path) as db:
        images = [
            DatabaseImage(image_id=i.image_id, name=i.name, camera_id=i.camera_id)
            for i in db.read_all_images()
        ]
    check_names((image.name for image in images), path)
    return sorted(images, key=lambda image: image.image_id)


def images_without_features(path: Path, names: Iterable[str]) -> list[str]:
    """The names that have no keypoints and descriptors yet."""
    if not path.is_file():
        return list(names)
    with open_database(path) as db:
        done = {
            i.name
            for i in db.read_all_images()
            if db.exists_keypoints(i.image_id) and db.exists_descriptors(i.image_id)
        }
    return [name for name in names if name not in done]


def images_without_keypoints(path: Path, names: Iterable[str]) -> list[str]:
    """The names that have no keypoints yet; descriptors do not matter."""
    with open_database(path) as db:
        done = {i.name for i in db.read_all_images() if db.exists_keypoints(i.image_id)}
    return [name for name in names if name not in done]


def read_keypoint_rows(path: Path, image_id: int) -> Float:
    """Keypoints (K, 2 to 6) of an image with all that is stored of them."""
    with open_database(path) as db:
        return np.asarray(db.read_keypoints(image_id), dtype=np.float64)


def read_keypoints(path: Path, image_ids: Iterable[int]) -> dict[int, Float]:
    """Keypoint positions (K, 2) px of each image, COLMAP's pixel origin."""
    with open_database(path) as db:
        return {
            i: np.asarray(db.read_keypoints(i), dtype=np.float64)[:, :2]
            if db.exists_keypoints(i)
            else np.zeros((0, 2))
            for i in image_ids
        }


def read_descriptors(path: Path, image_id: int) -> Array:
    """Descriptors (K, D) of one image."""
    with open_database(path) as db:
        descriptors = db.read_descriptors(image_id)
    return np.asarray(getattr(descriptors, "data", descriptors))


def write_features(
    path: Path, image_id: int, keypoints: Array, descriptors: tuple[int, Array] | None
) -> None:
    """Write the features of an image that has none, in one transaction.

    Parameters
    ----------
    keypoints : (K, 2 to 6); COLMAP knows two, four and six columns, others are cut down to these
    descriptors : COLMAP's number of the extractor, (K, bytes) uint8

    """
    columns = keypoints.shape[1] // 2 * 2
    size = keypoints.size * 4 + (0 if descriptors is None else descriptors[1].nbytes)
    with open_database(path) as db, transaction(db, path, 2, size):
        db.write_keypoints(image_id, np.ascontiguousarray(keypoints[:, :columns], dtype=np.float32))
        if descriptors is not None:
            kind, data = descriptors
            db.write_descriptors(
                image_id,
                pycolmap.FeatureDescriptors(
                    pycolmap.FeatureExtractorType(kind), np.ascontiguousarray(data)
                ),
            )


def read_matches(path: Path) -> dict[ImagePair, Int]:
    """All raw matches: pair of image ids -> (L, 2) keypoint indices."""
    with open_database(path) as db:
        pair_ids, matches = db.read_all_matches()
    return {
        _image_pair(p): np.asarray(m, dtype=np.int64)
        for p, m in zip(pair_ids, matches, strict=True)
    }


def _image_pair(pair_id: int) -> ImagePair:
    first, second = pycolmap.pair_id_to_image_pair(pair_id)
    return int(first), int(second)


def pairs_without_matches(path: Path, pairs: Sequence[ImagePair]) -> list[ImagePair]:
    """The pairs that the matches table does not know yet; an empty entry counts as known."""
    with open_database(path) as db:
        return [pair for pair in pairs if not db.exists_matches(*pair)]


def clear_matches(path: Path) -> None:
    """Forget all matches and two-view geometries."""
    with open_database(path) as db, transaction(db, path, 0, path.stat().st_size // 100):
        db.clear_two_view_geometries()
        db.clear_matches()


def write_matches(path: Path, matches: Mapping[ImagePair, Array]) -> None:
    """Write matches of pairs that have none yet."""
    size = sum(rows.size * INDEX_BYTES for rows in matches.values())
    with open_database(path) as db, transaction(db, path, len(matches), size):
        for (first, second), rows in matches.items():
            db.write_matches(first, second, np.ascontiguousarray(rows, dtype=np.uint32))


def write_two_view_geometries(
    path: Path, geometries: Mapping[ImagePair, tuple[Float | None, Array]]
) -> None:
    """Replace all two-view geometries, in one transaction.

    Parameters
    ----------
    geometries : pair of image ids -> (F (3, 3) or None, inlier matches (L, 2)). COLMAP knows no
        affine kind; UNCALIBRATED with F is what its mapper and triangulator accept.

    """
    configuration = pycolmap.TwoViewGeometryConfiguration
    size = sum(rows.size * INDEX_BYTES + GEOMETRY_BYTES for _, rows in geometries.values())
    with open_database(path) as db, transaction(db, path, len(geometries), size):
        db.clear_two_view_geometries()
        for (first, second), (F, rows) in geometries.items():
            geometry = pycolmap.TwoViewGeometry()
            if F is None or len(rows) == 0:
                geometry.config = int(configuration.DEGENERATE)
                geometry.inlier_matches = np.zeros((0, 2), dtype=np.uint32)
            else:
                geometry.config = int(configuration.UNCALIBRATED)
                geometry.F = F
                geometry.inlier_matches = np.ascontiguousarray(rows, dtype=np.uint32)
            db.write_two_view_geometry(first, second, geometry)


def read_inlier_matches(path: Path) -> dict[ImagePair, Int]:
    """Verified matches of all pairs that have any."""
    with open_database(path) as db:
        pair_ids, geometries = db.read_two_view_geometries()
    result = {}
    for p, g in zip(pair_ids, geometries, strict=True):
        rows = np.asarray(g.inlier_matches, dtype=np.int64)
        if len(rows):
            result[_image_pair(p)] = rows.reshape(-1, 2)
    return result


def replace_appended_keypoints(
    path: Path,
    keypoints: Mapping[int, tuple[int, Array]],
    geometries: Mapping[ImagePair, tuple[Float, Array]],
) -> None:
    """Put keypoints behind the measured ones, and their verified matches beside the others.

    What stood there from an earlier call is replaced; all in one transaction. The appended
    keypoints have no descriptors: they were found by a model, not by comparing descriptors.

    Parameters
    ----------
    keypoints : image id -> how many are measured, and the places (K, 2) to put behind them
    geometries : pair of image ids, the smaller first -> F, matches (L, 2) of appended keypoints

    """
    configuration = pycolmap.TwoViewGeometryConfiguration
    num_measured = {image_id: number for image_id, (number, _) in keypoints.items()}
    # the tables are written anew, at most six columns a keypoint, all matches once more
    size = sum((number + len(xy)) * 6 * 4 for number, xy in keypoints.values())
    size += sum(rows.size * INDEX_BYTES + GEOMETRY_BYTES for _, rows in geometries.values())
    with open_database(path) as db:
        pair_ids, known = db.read_two_view_geometries()
        size += sum(len(g.inlier_matches) * 2 * INDEX_BYTES for g in known)
        num_rows = len(keypoints) + len(geometries) + len(pair_ids)
    with open_database(path) as db, transaction(db, path, num_rows, size):
        for image_id, (number, xy) in keypoints.items():
            stored = np.asarray(db.read_keypoints(image_id), dtype=np.float32)[:number]
            if len(xy) == 0 and db.num_keypoints_for_image(image_id) == number:
                continue
            added = np.zeros((len(xy), stored.shape[1]), dtype=np.float32)
            added[:, :2] = xy
            # a circle of one pixel: as a scale, or as an affine shape
            added[:, [2] if stored.shape[1] == 4 else [2, 5] if stored.shape[1] == 6 else []] = 1.0
            db.update_keypoints(image_id, np.concatenate([stored, added]))
        pair_ids, known = db.read_two_view_geometries()
        for pair_id, geometry in zip(pair_ids, known, strict=True):
            a, b = _image_pair(pair_id)
            rows = np.asarray(geometry.inlier_matches, dtype=np.int64).reshape(-1, 2)
            measured = (rows[:, 0] < num_measured.get(a, np.inf)) & (
                rows[:, 1] < num_measured.get(b, np.inf)
            )
            if measured.all():
                continue
            if measured.any():
                geometry.inlier_matches = rows[measured].astype(np.uint32)
                db.update_two_view_geometry(a, b, geometry)
            else:
                db.delete_two_view_geometry(a, b)
        for (a, b), (F, rows) in geometries.items():
            # a pair that verification gave up is there too, without matches
            exists = db.exists_two_view_geometry(a, b)
            geometry = db.read_two_view_geometry(a, b) if exists else pycolmap.TwoViewGeometry()
            known = np.asarray(geometry.inlier_matches, dtype=np.int64).reshape(-1, 2)
            geometry.config = int(configuration.UNCALIBRATED)
            geometry.F = F
            geometry.inlier_matches = np.concatenate([known, rows]).astype(np.uint32)
            write = db.update_two_view_geometry if exists else db.write_two_view_geometry
            write(a, b, geometry)
