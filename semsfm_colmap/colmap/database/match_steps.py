"""Which filter dropped each raw match: a table of ours beside COLMAP's.

COLMAP keeps raw matches and those that a pair's geometry agrees with; what became of the rest, the
report wants to show. COLMAP and pycolmap pass over tables that they do not know.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from semsfm_colmap.colmap.database.side_tables import read_rows, replace_rows
from semsfm_colmap.colmap.database.work import ImagePair
from semsfm_colmap.types import AffineTwoViewGeometry, Array, Int

TABLE = "semsfm_match_steps"
SCHEMA = (
    "image_id1 INTEGER NOT NULL, image_id2 INTEGER NOT NULL, steps BLOB, "
    "PRIMARY KEY (image_id1, image_id2)"
)


def write_match_steps(path: Path, steps: Iterable[tuple[ImagePair, Array]]) -> None:
    """Replace the steps of all pairs: the smaller id first, a byte for each row of its matches."""
    rows = [(*sorted(pair), np.asarray(step, dtype=np.uint8).tobytes()) for pair, step in steps]
    replace_rows(path, TABLE, SCHEMA, rows)


def read_match_steps(path: Path) -> dict[ImagePair, Int]:
    """The steps by pair of image ids, (L,) each; none from a database that has none."""
    return {
        (a, b): np.frombuffer(data, dtype=np.uint8).astype(np.int64)
        for a, b, data in read_rows(path, TABLE) or ()
    }


def stored_steps(
    geometries: Iterable[AffineTwoViewGeometry], image_ids: Sequence[int]
) -> list[tuple[ImagePair, Array]]:
    """What `write_match_steps` takes, of the geometries that tell."""
    return [
        ((image_ids[g.image_pair[0]], image_ids[g.image_pair[1]]), g.step)
        for g in geometries
        if g.step is not None
    ]
