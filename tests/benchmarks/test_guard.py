"""What the guard prints of two entries."""

from benchmarks.guard import figures_of, load, machine, rows

LAST = {
    "stages": {"map": {"CPU s": 10.0, "peak MB": 400}, "mesh": {"CPU s": 5.0, "peak MB": 100}},
    "work": {"points": 2000},
}
NOW = {
    "stages": {"map": {"CPU s": 8.0, "peak MB": 400}, "mesh": {"CPU s": 5.5, "peak MB": 100}},
    "work": {"points": 2100, "faces": 7},
}


def test_changes_are_shares_of_the_last_entry_and_new_figures_have_none():
    table = {row[0]: row[1:] for row in rows(LAST, NOW)}
    assert table["map, CPU s"] == ["10", "8", "-20 %"]
    assert table["mesh, CPU s"] == ["5", "5.5", "+10 %"]
    assert table["all stages, CPU s"] == ["15", "13.5", "-10 %"]
    assert table["points"] == ["2000", "2100", "+5 %"]
    assert table["faces"] == ["-", "7", "-"]


def test_the_first_entry_has_nothing_to_compare_with():
    assert all(row[1] == row[3] == "-" for row in rows(None, NOW))
    assert figures_of({}) == {}


def test_no_file_holds_no_entries_and_the_machine_is_named(tmp_path):
    assert load(tmp_path / "guard.json") == []
    assert "cores" in machine()
