from __future__ import annotations

import os
from pathlib import Path

from semsfm_colmap.pipeline.record import RunRecord, hash_text


def test_names_that_are_not_utf8_are_hashed_and_kept(tmp_path: Path) -> None:
    name = os.fsdecode(b"bad\xff.tif")
    assert hash_text(name) != hash_text("bad.tif")
    record = RunRecord(path=tmp_path / "run.json", inputs={name: "1:2:abc"}, image_path=name)
    record.write()
    again = RunRecord.read(tmp_path / "run.json")
    assert (again.inputs, again.image_path) == (record.inputs, name)
