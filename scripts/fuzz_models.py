"""Damage a COLMAP model at random: it is read, or refused in one sentence, in time and memory.

    python scripts/fuzz_models.py --seconds 600

Files of a small model, binary and text, are cut, bits of them flipped, numbers overwritten, bytes
taken out; then both of our readers of models of others read it. A finding, which a number that
overflows is too, ends the run with exit code 1 and leaves the damaged model in --findings.
"""

from __future__ import annotations

import argparse
import random
import resource
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.any_model import read_any_model
from semsfm_colmap.colmap.model.pinhole_reading import read_pinhole_model
from semsfm_colmap.errors import InputError

MEMORY_MB = 6144
"""Address space; pycolmap's libraries alone take half of it."""
SECONDS_PER_INPUT = 2.0
MAX_SENTENCE = 600
FILES = ("cameras", "images", "points3D", "rigs", "frames")
PATTERNS = (b"\xff" * 8, b"\0" * 8, b"\0\0\0\0\0\0\xf8\x7f", b" nan -1 ", b" 99999999999")


def write_small_model(folder: Path) -> None:
    """Six cameras, sixty points, binary in `folder`/bin and text in `folder`/txt."""
    rng = np.random.default_rng(0)
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(
        pycolmap.Camera.create_from_model_name(1, "PINHOLE", 3000.0, 320, 240)
    )
    points = rng.uniform(-1, 1, (60, 3))
    for i in range(6):
        turn = pycolmap.Rotation3d(np.array([0.0, 0.1 * i, 0.0]))
        x = points @ turn.matrix().T + [0.0, 0.0, 30.0]
        xy = 3000.0 * x[:, :2] / x[:, 2:] + [160.0, 120.0]
        image = pycolmap.Image(name=f"view {i}.png", keypoints=xy, camera_id=1, image_id=i + 1)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(turn, np.array([0.0, 0.0, 30])))
    for j, point in enumerate(points):
        track = pycolmap.Track()
        for i in range(6):
            track.add_element(i + 1, j)
        model.add_point3D(point, track, np.full(3, 90, np.uint8))
    for end in ("bin", "txt"):
        (folder / end).mkdir(parents=True)
    model.write_binary(str(folder / "bin"))
    model.write_text(str(folder / "txt"))


def damage(content: bytes, rng: random.Random) -> bytes:
    """Cut, bits flipped, a number overwritten, or some bytes taken out."""
    data = bytearray(content)
    how, at = rng.randrange(4), rng.randrange(len(data))
    if how == 0:
        return bytes(data[:at])
    if how == 1:
        for _ in range(rng.choice((1, 1, 3, 10))):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif how == 2:
        pattern = rng.choice(PATTERNS)
        data[at : at + len(pattern)] = pattern
    else:
        del data[at : at + rng.choice((1, 4, 8))]
    return bytes(data)


def read_everywhere(path: Path) -> int:
    """How many of the readers take the model; anything but InputError comes through."""
    taken = 0
    for read in (read_any_model, lambda p: read_pinhole_model(p, max_deviation_px=1e9)):
        try:
            read(path)
            taken += 1
        except InputError as error:
            if len(str(error)) > MAX_SENTENCE or "\n" in str(error):
                raise ValueError(f"no sentence: {error}") from error
    return taken


def fuzz(seconds: float, trials: int | None, seed: int, findings: Path) -> int:
    """Damage and read until the time or the trials are over; 1 with a finding."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_MB << 20, MEMORY_MB << 20))
    warnings.simplefilter("error", RuntimeWarning)
    rng = random.Random(seed)
    count = taken = 0
    with tempfile.TemporaryDirectory() as folder:
        write_small_model(Path(folder))
        end_time = time.monotonic() + seconds
        path = Path(folder) / "damaged"
        while time.monotonic() < end_time and (trials is None or count < trials):
            end = rng.choice(("bin", "txt"))
            shutil.rmtree(path, ignore_errors=True)
            shutil.copytree(Path(folder) / end, path)
            file = path / f"{rng.choice(FILES)}.{end}"
            file.write_bytes(damage(file.read_bytes(), rng))
            start = time.process_time()
            try:
                taken += read_everywhere(path) > 0
                if time.process_time() - start > SECONDS_PER_INPUT:
                    raise TimeoutError(f"{time.process_time() - start:.1f} s of processor time")
            except Exception as error:
                shutil.copytree(path, findings / str(count), dirs_exist_ok=True)
                print(f"{file.name}: {type(error).__name__}: {error}; in {findings / str(count)}")
                return 1
            count += 1
    print(f"{count} damaged models, {count - taken} refused, nothing found")
    return 0


def main(arguments: Iterable[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--trials", type=int, help="stop after so many")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--findings", type=Path, default=Path("fuzz_findings"))
    chosen = parser.parse_args(list(arguments) if arguments is not None else None)
    return fuzz(chosen.seconds, chosen.trials, chosen.seed, chosen.findings)


if __name__ == "__main__":
    sys.exit(main())
