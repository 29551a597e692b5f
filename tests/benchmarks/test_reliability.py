"""The faults of docs/reliability.md: what counts as wrong, and which cases there are."""

import json
import os
import shutil

import numpy as np
import tifffile

from benchmarks.reliability import damage, disks, inputs, kills
from benchmarks.reliability.__main__ import measured
from benchmarks.reliability.projects import Series, differences, running_stage


def test_a_project_differs_by_content_by_what_is_missing_and_by_what_is_left(
    small_project, tmp_path
):
    project = shutil.copytree(small_project, tmp_path / "p")
    assert differences(project, small_project) == []
    (project / "sparse" / "0" / "cameras.bin").write_bytes(b"other")
    (project / "mesh" / "mesh.obj").unlink()
    (project / "dense" / ".fused.ply.part").write_bytes(b"")
    (project / "database.db").write_bytes(b"")
    assert differences(project, small_project) == [
        "mesh/mesh.obj is missing",
        "dense/.fused.ply.part is left",
        "database.db differs",
        "sparse/0/cameras.bin differs",
    ]


def test_every_file_is_damaged_and_another_one_each_time(small_project):
    series = Series(images=small_project, reference=small_project)
    names = damage.outputs(series)
    assert {"database.db", "run.json", "semsfm.toml", "sparse/0/frames.bin"} <= set(names)
    content = bytes(range(9))
    found = [damage.damaged(content, way) for way in damage.WAYS if way != "deleted"]
    assert found == [b"", content[:4], content[:4] + b"\x05" + content[5:]]


def test_disks_are_as_many_and_as_large_as_asked_for():
    sizes = disks.sizes_kb(30)
    assert (len(set(sizes)), sizes[0], sizes[-1]) == (30, 300, 20000)


def test_what_was_measured_is_not_measured_again(tmp_path):
    ran = []

    def do():
        ran.append(1)
        return {"stage": "map", "wrong": []}

    for _ in range(2):
        results = measured(tmp_path / "kills.jsonl", [("kill 0", do), ("kill 1", do)])
    assert len(ran) == 2
    assert list(kills.rows(results)) == [("map", 2, 2), ("all", 2, 2)]


def test_the_stage_that_was_killed_is_read_from_run_json(tmp_path):
    assert running_stage(tmp_path) == "ingest"
    stages = {"extract": {"status": "done"}, "match": {"status": "running"}}
    (tmp_path / "run.json").write_text(json.dumps({"stages": stages}))
    assert running_stage(tmp_path) == "match"


def test_every_bad_input_is_another_folder_or_has_options_and_is_named_once(tmp_path):
    whats = [row.what for row in inputs.ROWS]
    assert len(set(whats)) == len(whats)
    for number, row in enumerate(inputs.ROWS):
        folder = tmp_path / str(number) / "images"
        folder.mkdir(parents=True)
        for k in range(5):
            image = np.random.default_rng(k).integers(0, 255, (64, 64), np.uint8)
            image[:, :30] = 0  # an empty background
            tifffile.imwrite(folder / f"grain_{k:03d}.tif", image)
        before = contents(folder)
        options = row.make(folder)
        assert options or contents(folder) != before, row.what


def contents(folder):
    names = sorted(os.fsencode(p) for p in folder.rglob("*"))
    return names, [p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()]


def test_what_a_terminal_obeys_and_what_is_left_is_found():
    assert inputs.obeyed("plain\ntext") == []
    assert inputs.obeyed("a\x1b[2Jb\u202ec") == [r"'\u202e'", r"'\x1b'"]
    assert inputs.is_left("elsewhere.txt", 0)
    assert inputs.is_left("p/dense/.fused.ply.part", 0)
    assert inputs.is_left("p/images/a.png", 2)
    assert not inputs.is_left("p/images/a.png", 1)
    assert not inputs.is_left("p/.semsfm.lock", 0)


def test_the_sentence_is_the_one_that_names_the_fault():
    said = "warning: a.tif: cut short. Left out.\nimages: 4\nsemsfm reconstruct: too few\n"
    assert inputs.sentence(said, "a.tif") == "a.tif: cut short. Left out."
    assert inputs.sentence(said, "") == "semsfm reconstruct: too few"
    assert list(inputs.rows([{"what": "x", "said": "", "code": 0}])) == [("x", "nothing", 0)]
