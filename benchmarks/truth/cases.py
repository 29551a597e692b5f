"""Series that once gave a confident wrong answer: what is said of them."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

from benchmarks.tables import table
from benchmarks.truth.measured import STAGES
from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.records import MapRecord

CASES = {
    "planar_0_48/images_rot0": "48.0 deg, a plane",
    "planar_0_48/images_rot2": "49.4 deg, a plane that also turns in the image",
    "anisotropic_shrink/images": "35.9 deg, each frame 2 % less high",
    "false_scan_drift/images": "no drift, magnifications differ by 9 %",
    "stem_needle_haadf/images": "-76 to 76 deg, transmission",
}
HEAD = ("case", "true", "answer", "what is said")


def answer(images: Path, project: Path, *, databar: bool, num_threads: int) -> tuple[str, str]:
    """The total rotation with its sigma or "no model", and the sentences."""
    config = replace(
        Config(), num_threads=num_threads, ingest=IngestOptions(detect_databar=databar)
    )
    try:
        record = run_stages(project, config, names=STAGES, image_path=images)
    except InputError as error:
        return "no model", str(error).removeprefix(str(project) + ": ")
    result = record.result("map", MapRecord)
    assert result is not None
    trust = result.reliability
    said = f"{trust.total_rotation_deg:.1f} +- {trust.total_rotation_sigma_deg:.1f} deg"
    return said, "; ".join(result.notes)


def answers(cases: Path, folder: Path, *, num_threads: int) -> str:
    """The table of the cases below a folder."""
    rows = []
    for name, true in CASES.items():
        project = folder / "cases" / name
        shutil.rmtree(project, ignore_errors=True)
        told = answer(
            cases / name, project, databar=not name.startswith("planar"), num_threads=num_threads
        )
        rows.append([name.removesuffix("/images"), true, *told])
        print(" | ".join(rows[-1][:3]), flush=True)
    return table(HEAD, rows)
