"""Progress: shares and time left, lines where there is no terminal, a bar where there is one."""

import io
import sys
import time
from types import ModuleType, SimpleNamespace

import pytest

from semsfm_colmap.mapping.context import PHASES
from semsfm_colmap.pipeline import progress
from semsfm_colmap.pipeline.progress import duration, line, phases_shown, time_left
from semsfm_colmap.pipeline.reporter import Reporter


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (59.4, "59 s"), (125.0, "2 min 5 s"), (4805, "1 h 20 min")]
)
def test_a_duration_is_told_in_the_unit_of_its_size(seconds, text):
    assert duration(seconds) == text


def test_time_left_is_the_rest_over_what_is_done():
    assert time_left(30.0, 0.25) == "about 1 min 30 s left"
    assert time_left(30.0, 0.01) == ""
    assert time_left(30.0, 1.0) == ""
    assert line("features", 0.5, 7.0) == "features: 50 %, about 7 s left"
    assert line("meshing", 0.0, 7.0) == "meshing: 7 s"


def test_one_display_runs_through_all_phases_and_never_back():
    seen = []
    step = phases_shown("map", {"a": 0.2, "b": 0.5, "c": 0.3}, lambda *shown: seen.append(shown))
    for phase, done, total in (("a", 0, 1), ("a", 1, 2), ("b", 1, 5), ("a", 1, 2), ("c", 1, 1)):
        step(phase, done, total)
    assert [label for label, _ in seen] == ["map: a", "map: a", "map: b", "map: a", "map: c"]
    assert [share for _, share in seen] == pytest.approx([0.0, 0.1, 0.3, 0.3, 1.0])
    assert sum(PHASES.values()) == pytest.approx(1.0)


def test_without_a_terminal_lines_come_also_of_what_calls_nobody(monkeypatch, capsys):
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LINES", 0.02)
    with Reporter().progress("meshing"):
        time.sleep(0.1)
    with Reporter().progress("depth maps") as step:
        step(1, 2)
        time.sleep(0.1)
        step(2, 2)
        time.sleep(0.06)
    said = capsys.readouterr().err.splitlines()
    assert "  meshing: 0 s" in said
    assert "  depth maps: 50 %, about 0 s left" in said
    assert not any("100 %" in one for one in said)
    with Reporter(verbosity=-1).progress("quiet") as step:
        step(1, 2)
        time.sleep(0.06)
    assert capsys.readouterr().err == ""


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_on_a_terminal_a_bar_says_the_time_left(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    with Reporter().phases("map", PHASES) as step:
        step("guided passes", 1, 2)
        time.sleep(0.25)
    assert "map: guided passes" in terminal.getvalue()
    assert "45 %" in terminal.getvalue()
    assert "left" in terminal.getvalue()


def test_a_link_in_the_place_of_the_log_is_not_written_through(tmp_path):
    other = tmp_path / "other.txt"
    other.write_text("theirs")
    log = tmp_path / "semsfm.log"
    log.symlink_to(other)
    reporter = Reporter(-1)
    reporter.log_to(log)
    reporter.say("ours\x1b[2J")
    reporter.close()
    assert other.read_text() == "theirs"
    assert not log.is_symlink()
    assert "ours\\x1b[2J" in log.read_text(encoding="utf-8")


def test_in_a_notebook_one_line_below_the_cell_changes_and_goes(monkeypatch):
    texts = []
    handle = SimpleNamespace(update=lambda data, raw: texts.append(data["text/plain"]))
    notebook = ModuleType("IPython")
    notebook.get_ipython = lambda: SimpleNamespace(kernel=object())
    shown = ModuleType("IPython.display")
    shown.display = lambda data, raw, display_id: handle
    monkeypatch.setitem(sys.modules, "IPython", notebook)
    monkeypatch.setitem(sys.modules, "IPython.display", shown)
    monkeypatch.setattr(progress, "SECONDS_IN_NOTEBOOK", 0.02)
    with progress.display() as show:
        show("depth maps", 0.4)
        time.sleep(0.2)
    assert "depth maps: 40 %" in texts[0]
    assert texts[-1] == ""


def test_a_shell_without_a_kernel_is_no_notebook(monkeypatch):
    shell = ModuleType("IPython")
    shell.get_ipython = SimpleNamespace
    monkeypatch.setitem(sys.modules, "IPython", shell)
    assert not progress.in_notebook()
    monkeypatch.delitem(sys.modules, "IPython")
    assert not progress.in_notebook()
