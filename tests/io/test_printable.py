import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.io.printable import printable
from semsfm_colmap.pipeline.reporter import Reporter

HOSTILE = ("\x1b[2J", "\x9b31m", "\u202e", "\r", "\n", "\x07", "\x00", "\u2028", "\u2066", "\x7f")


@pytest.mark.parametrize("escape", HOSTILE)
def test_what_a_terminal_obeys_is_written_out(escape):
    shown = printable(f"a{escape}b.tif")
    assert not set(escape[0]) & set(shown)
    assert "\\" in shown


@pytest.mark.parametrize("text", ["plain", "über µm 试样.tif", "5 × 3 → 2", "a\tb", "\u2009thin"])
def test_other_text_stays(text):
    assert printable(text) == text


@pytest.mark.parametrize("escape", [e for e in HOSTILE if e != "\x00"])
def test_an_error_and_a_warning_about_a_name_do_not_pass_it_on(tmp_path, capsys, escape):
    assert main(["map", str(tmp_path / f"a{escape}b")]) == 2
    reporter = Reporter()
    reporter.log_to(tmp_path / "log")
    reporter.warn(f"a{escape}b")
    reporter.close()
    said = capsys.readouterr().err.split("\n")
    assert len(said) == 3
    assert not set(escape[0]) & set("".join(said))
    assert (tmp_path / "log").read_text(encoding="utf-8").count("\n") == 1
