from __future__ import annotations

from pathlib import Path

from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.images import save, texture

OPTIONS = IngestOptions()


def test_outputs_of_an_earlier_run_go_but_other_files_stay(folder: Path, tmp_path: Path) -> None:
    for i in range(4):
        save(folder / f"s/{i}.png", texture(i))
    prepare_series(folder, tmp_path / "p", OPTIONS)
    (tmp_path / "p/images/foreign.txt").write_text("keep")
    (folder / "s/3.png").rename(folder / "3.png")
    series = prepare_series(folder, tmp_path / "p", OPTIONS)
    left = {
        p.relative_to(tmp_path / "p/images").as_posix()
        for p in (tmp_path / "p/images").rglob("*")
        if p.is_file()
    }
    assert left == {*series.names, "foreign.txt"}
