import re
import unicodedata
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from semsfm_colmap.errors import MissingDependencyError
from semsfm_colmap.report import html
from semsfm_colmap.report.figures import draw_figures
from semsfm_colmap.report.html import render_page
from semsfm_colmap.report.html_parts import script_json
from semsfm_colmap.report.inputs import StageUsage
from semsfm_colmap.report.metrics import compute_metrics
from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.report.viewer.html import SCRIPTS
from semsfm_colmap.types import PointCloud
from tests.report.series import (
    chain_of_pairs,
    cube,
    empty_reconstruction,
    guided_figures,
    make_inputs,
    make_reconstruction,
    sphere,
)

OPTIONS = ReportOptions(figure_dpi=60)
NAMES = (
    "a b c.png",
    "花粉 ünï.png",
    "<script>alert(1)</script>.png",
    "\"q'&amp;.png",
    "$x_1$ %{text}.png",
    "<!--<script>.png",
    "<img src=http://example.org/x.png>.png",
)


TURNED = "lost\u202egnp.\x9b2J\x1b[1m.png"
"""Turned writing, and C1 and C0 sequences."""


class Reader(HTMLParser):
    """Collects the elements, their addresses and the text between them."""

    def __init__(self):
        super().__init__(convert_charrefs=True)
        self.tags, self.addresses, self.text, self.open = [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value for key, value in attrs if key in {"src", "href", "action"}]
        if tag not in {"meta", "img", "input", "br", "link"}:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in {"script", "style"}:
            self.text.append(data)


def render(inputs):
    metrics = compute_metrics(inputs)
    return render_page(inputs, metrics, draw_figures(inputs, metrics, OPTIONS), OPTIONS)


def read(page):
    reader = Reader()
    reader.feed(page)
    reader.close()
    assert reader.open == []
    return reader


@pytest.fixture(scope="module")
def hostile_page():
    rec = make_reconstruction(np.arange(7) * 8.0, image_names=NAMES)
    pairs = [*chain_of_pairs(NAMES)]
    return render(
        make_inputs(
            rec,
            names=[*NAMES, "lost <i>.png", TURNED],
            pairs=tuple(pairs),
            notes=("A note <b>with</b> markup & more.",),
            versions={"<u>lib</u>": "1 < 2"},
            stages=(StageUsage(name="<s>stage</s>", seconds=1.0),),
            title="</title><script>alert(2)</script>",
            mesh=cube(),
        )
    )


def test_names_appear_as_they_are_and_never_as_markup(hostile_page):
    reader = read(hostile_page)
    text = " ".join(reader.text)
    for name in (*NAMES, "lost <i>.png", "A note <b>with</b> markup & more.", "<u>lib</u>"):
        assert name in text
    assert not {"i", "b", "u", "s"} & set(reader.tags)
    # the data, three.js and the viewer's own scripts
    assert reader.tags.count("script") == 2 + len(SCRIPTS)
    assert "alert(1)</script>.png" not in hostile_page


def test_no_name_turns_the_writing_or_holds_a_control_character(hostile_page):
    reader = read(hostile_page)
    text = " ".join(reader.text)
    assert r"lost\u202egnp.\x9b2J\x1b[1m.png" in text
    left = {c for c in text if unicodedata.category(c) in ("Cc", "Cf")} - {"\n", "\t"}
    assert not left


def test_the_page_asks_for_nothing_from_outside(hostile_page):
    reader = read(hostile_page)
    assert reader.addresses
    assert all(
        a.startswith(("#", "data:image/png;base64,", "data:image/webp;base64,"))
        for a in reader.addresses
    )
    assert "link" not in reader.tags
    assert "iframe" not in reader.tags
    style = re.search(r"<style>(.*?)</style>", hostile_page, re.DOTALL)
    assert style is not None
    assert "url(" not in style[1]
    assert "@import" not in style[1]
    assert "default-src &#x27;none&#x27;" in hostile_page
    assert "unsafe-eval" not in hostile_page


def test_every_link_within_the_page_has_its_target(hostile_page):
    for address in read(hostile_page).addresses:
        if address.startswith("#"):
            assert f'id="{address[1:]}"' in hostile_page


def test_no_string_closes_a_script():
    text = script_json({"name": "</script><!-- & \u2028"}, element_id="x")
    assert text.count("<") == 2
    assert text.endswith("</script>")


def test_a_large_model_stays_within_the_size_of_the_page():
    rng = np.random.default_rng(0)
    num = 300
    rec = make_reconstruction(
        np.arange(num) * 1.2,
        num_points=30_000,
        point_color=rng.integers(0, 256, (30_000, 3)).astype(np.uint8),
    )
    cloud = PointCloud(
        points=8.0 * rng.normal(size=(50_000, 3)),
        colors=rng.integers(0, 256, (50_000, 3)).astype(np.uint8),
    )
    pairs = tuple(p for _ in range(20) for p in chain_of_pairs(rec.image_names))
    inputs = make_inputs(rec, mesh=sphere(160), cloud=cloud, pairs=pairs)
    metrics = compute_metrics(inputs)
    page = render_page(inputs, metrics, draw_figures(inputs, metrics), ReportOptions(max_page_mb=3))
    assert 2e6 < len(page.encode()) < 3e6


def test_where_the_library_is_missing_the_page_has_a_still_picture_and_the_reason(monkeypatch):
    def missing():
        raise MissingDependencyError("there is no three.js: install it")

    monkeypatch.setattr(html, "viewer_scripts", missing)
    reader = read(render(make_inputs(make_reconstruction(np.arange(3) * 8.0))))
    assert "there is no three.js: install it." in reader.text
    assert "script" not in reader.tags
    assert "canvas" not in reader.tags


@pytest.mark.parametrize("num_images", [0, 1, 2])
def test_a_failed_reconstruction_still_has_a_page(num_images):
    rec = empty_reconstruction(num_images)
    names = (*rec.image_names, "a", "b", "c")[:3]
    text = " ".join(read(render(make_inputs(rec, names=names))).text)
    assert "There are no points" in text
    assert f"{num_images} of 3 images registered" in text
    assert "There is nothing to show" in text


def test_the_verdict_says_what_to_doubt():
    rec = make_reconstruction(np.arange(3) * 2.0)
    inputs = make_inputs(rec)
    text = " ".join(read(render_page(inputs, compute_metrics(inputs), ())).text)
    assert "What to doubt" in text
    assert "the angles and depths may be off" in text


def test_many_rejected_pairs_are_cut_off_and_counted():
    rec = make_reconstruction(np.arange(9) * 5.0)
    pairs = tuple(replace(p, failure="no overlap") for p in chain_of_pairs(rec.image_names))
    inputs = make_inputs(rec, pairs=pairs)
    metrics = compute_metrics(inputs)
    page = render_page(inputs, metrics, (), ReportOptions(max_pair_rows=3))
    assert page.count('<td class="text">no overlap</td>') == 3
    assert "5 more rejected pairs" in page


def test_the_guided_pass_is_told_with_its_figures_and_its_absence_too():
    inputs = make_inputs(make_reconstruction(np.arange(0.0, 60.0, 10.0)))
    reader = Reader()
    reader.feed(render(inputs))
    assert "no guided second pass" in " ".join(reader.text)
    reader = Reader()
    reader.feed(render(replace(inputs, guided=guided_figures())))
    text = " ".join(reader.text)
    for figure in ("finer than 2 px", "pass 4", "0.42 px", "13.8", "0.372", "0.161"):
        assert figure in text


def test_a_verdict_without_doubts_points_to_the_notes_where_there_are_some():
    sound = make_reconstruction(np.arange(10) * 4.0)
    noted = render(make_inputs(sound, notes=("depth is uncertain by 20 %",), mesh=sphere()))
    assert "found nothing beside what the notes from the run say." in noted
