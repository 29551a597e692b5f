import stat

import pytest

from semsfm_colmap.errors import InputError, MissingDependencyError
from semsfm_colmap.pipeline.report_pdf import BROWSERS, find_browser, write_pdf
from tests.browser import chromium


@pytest.fixture
def page(tmp_path):
    path = tmp_path / "a folder with spaces" / "report.html"
    path.parent.mkdir()
    path.write_text("<!DOCTYPE html><title>x</title><h1>A report</h1>")
    return path


def browser_that(folder, monkeypatch, script):
    path = folder / BROWSERS[-1]
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(folder), prepend=None)
    return path


def test_without_a_browser_one_sentence_says_what_to_install(page, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingDependencyError, match="needs Chromium, Chrome or Edge"):
        write_pdf(page, page.with_suffix(".pdf"))


def test_any_of_the_browsers_will_do(tmp_path, monkeypatch):
    path = browser_that(tmp_path, monkeypatch, "exit 0")
    assert find_browser() == str(path)


def test_a_browser_that_prints_nothing_leaves_the_old_pdf(page, tmp_path, monkeypatch):
    pdf = page.with_suffix(".pdf")
    pdf.write_bytes(b"%PDF old")
    browser_that(tmp_path, monkeypatch, "echo no display >&2; exit 3")
    with pytest.raises(InputError, match=r"did not print .*: no display"):
        write_pdf(page, pdf)
    assert pdf.read_bytes() == b"%PDF old"
    assert [p.name for p in sorted(page.parent.iterdir())] == ["report.html", "report.pdf"]


@pytest.mark.slow
def test_a_page_is_printed(page):
    chromium()
    pdf = page.with_suffix(".pdf")
    write_pdf(page, pdf)
    assert pdf.read_bytes().startswith(b"%PDF")
    assert pdf.stat().st_size > 1000
