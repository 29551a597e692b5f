"""Cameras and points from a COLMAP database that something else has filled.

    python examples/own_colmap_database.py DATABASE SPARSE [IMAGES]

The database may hold keypoints and matches of any program; it is only read. What is written is a
COLMAP model that every COLMAP tool opens, with orthographic.json beside it for what COLMAP cannot
hold.
"""

from __future__ import annotations

import sys
from pathlib import Path

import semsfm_colmap as semsfm


def main(database_path: Path, sparse_path: Path, image_path: Path | None = None) -> None:
    """Map the database and say what came of it."""
    record = semsfm.map_database(database_path, sparse_path, image_path=image_path)
    print(f"{record.num_images} images, {record.num_points} points, {record.rms_px:.2f} px RMS")
    for note in record.notes:
        print("note:", note)
    model = semsfm.read_model(sparse_path / "0")
    # no image residual tells the object from its depth-reversed twin: this says what does
    hand = model.depth_sign
    print(f"hand: {hand.status}, confidence {hand.confidence:.2f}; {hand.message}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]) if len(sys.argv) > 3 else None)
