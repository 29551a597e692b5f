"""Simulated tracks as a COLMAP database, mapped by pycolmap in a process of its own."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.synthetic.tracks import SimulatedTracks


def map_with_colmap(
    s: SimulatedTracks, focal_px: float, folder: Path
) -> tuple[Any, tuple[float, float]]:
    """The expert set-up in a process of its own, which may abort; model or None, wall and CPU s."""
    from semsfm_colmap.colmap.library import pycolmap

    database = folder / "database.db"
    write_database(s, database, focal_px)
    pairs = folder / "pairs.txt"
    M = len(s.cameras)
    pairs.write_text(
        "".join(
            f"{i:04d}.png {j:04d}.png\n" for i in range(M) for j in range(i + 1, min(i + 11, M))
        )
    )
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.geometry.colmap_mapping", str(folder)],
        cwd=Path(__file__).parents[2],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        timeout=600,
        check=False,
    )
    said = dict(x.split() for x in done.stdout.splitlines() if x.startswith(("SECONDS ", "CPU ")))
    seconds = (float(said.get("SECONDS", "nan")), float(said.get("CPU", "nan")))
    models = [pycolmap.Reconstruction(str(p.parent)) for p in folder.glob("*/points3D.bin")]
    if "CPU" not in said or not models:
        return None, seconds
    return max(models, key=lambda m: m.num_reg_images()), seconds


def write_database(s: SimulatedTracks, path: Path, focal_px: float, size: int = 1200) -> None:
    """The simulated tracks as a COLMAP database with matches and two-view geometries."""
    from semsfm_colmap.colmap.library import pycolmap

    obs = s.observations
    keypoints = []
    row_of = np.full((obs.num_images, obs.num_tracks), -1)
    for i in range(obs.num_images):
        o = np.flatnonzero(obs.image_idx == i)
        keypoints.append(obs.xy[o])
        row_of[i, obs.track_idx[o]] = np.arange(len(o))
    with pycolmap.Database.open(str(path)) as db, pycolmap.DatabaseTransaction(db):
        camera = pycolmap.Camera(
            model="SIMPLE_PINHOLE",
            width=size,
            height=size,
            params=[focal_px, size / 2, size / 2],
            has_prior_focal_length=True,
        )
        camera_id = db.write_camera(camera)
        for i in range(obs.num_images):
            db.write_image(
                pycolmap.Image(name=f"{i:04d}.png", camera_id=camera_id, image_id=i + 1), True
            )
            db.write_keypoints(i + 1, keypoints[i].astype(np.float32))
        for i in range(obs.num_images):
            for j in range(i + 1, min(i + 11, obs.num_images)):
                both = np.flatnonzero((row_of[i] >= 0) & (row_of[j] >= 0))
                if len(both) >= 15:
                    pair = np.column_stack([row_of[i, both], row_of[j, both]]).astype(np.uint32)
                    db.write_matches(i + 1, j + 1, pair)


def run_colmap(folder: Path) -> None:
    """Verify and map: fixed long focal length, raised filter on focal lengths."""
    from semsfm_colmap.colmap.library import pycolmap

    database = str(folder / "database.db")
    pycolmap.verify_matches(database, str(folder / "pairs.txt"))
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = False
    options.ba_refine_extra_params = False
    options.max_focal_length_ratio = 1e9
    options.mapper.max_focal_length_ratio = 1e9
    options.triangulation.max_focal_length_ratio = 1e9
    begin, begin_cpu = time.monotonic(), time.process_time()
    pycolmap.incremental_mapping(database, str(folder), str(folder), options=options)
    print(f"SECONDS {time.monotonic() - begin:.3f}", flush=True)
    print(f"CPU {time.process_time() - begin_cpu:.3f}", flush=True)


if __name__ == "__main__":
    run_colmap(Path(sys.argv[1]))
