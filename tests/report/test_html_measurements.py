import io
from html.parser import HTMLParser

import numpy as np
import PIL.Image

from semsfm_colmap.report.figures_measurements import draw_marks, picked_images
from semsfm_colmap.report.html_measurements import measurements_page, unit_text


def entry(name="width", unit="px", **more):
    return {
        "name": name,
        "what": "distance of a.tif:3,4, a.tif:30,40",
        "where": [{"image": "a.tif", "xy": [[3.0, 4.0]]}, {"image": "a.tif", "xy": [[30.0, 40.0]]}],
        "value": 45.0,
        "unit": unit,
        "standard_uncertainty": 0.5,
        "coverage_factor": 1.96,
        "expanded_uncertainty": 0.98,
        "interval_95": [44.02, 45.98],
        "facts": {"rms_deviation": 0.123},
        "remarks": ["read this"],
        "budget": [
            {
                "source": "picking", "kind": "B", "size": 0.3, "size_unit": "px",
                "sensitivity": 1.0, "contribution": 0.3, "share": 0.36,
            },
            {
                "source": "cameras: noise", "kind": "A", "size": None, "size_unit": "",
                "sensitivity": None, "contribution": 0.4, "share": 0.64,
            },
        ],
        "not_assessed": ["distortion of the scan"],
        **more,
    }  # fmt: skip


def data(*ones, checks=(), pixel_size=None):
    return {
        "pixel_size_um": pixel_size,
        "pixel_size_source": "header",
        "notes": ["a note"],
        "measurements": list(ones),
        "checks": list(checks),
    }


class Balanced(HTMLParser):
    """Counts what is open."""

    VOID = frozenset({"meta", "img", "br", "polygon", "polyline", "input"})

    def __init__(self):
        super().__init__()
        self.open = []

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_units_are_written_as_a_person_writes_them():
    assert [unit_text(unit) for unit in ("um", "um^2", "px^3", "deg")] == ["µm", "µm²", "px³", "°"]


def test_the_page_is_well_formed_and_names_cannot_become_markup():
    check = {"length": 44.0, "sigma": 0.1, "deviation": 1.0, "E_n": 1.4, "agrees": False}
    rows = [[0.0, 0.0, 0.1], [1.0, 2.0, 0.2], [2.0, 0.0, 0.1]]
    page = measurements_page(
        data(entry("<b>width"), entry("line", profile=rows), checks=[entry("bar", check=check)]),
        "<project>",
    )
    parser = Balanced()
    parser.feed(page)
    assert parser.open == []
    assert "<b>width" not in page
    assert "&lt;b&gt;width" in page
    assert 'class="absent"' in page  # the check that does not agree
    assert "<svg" in page
    assert "read this" in page


def test_without_a_scale_no_length_is_in_micrometres():
    page = measurements_page(data(entry()), "p")
    assert "none is known: lengths are in px" in page
    assert "µm" not in page


def test_what_was_picked_is_drawn_into_its_image():
    ones = [entry(), entry("again")]
    assert picked_images(ones) == ["a.tif"]
    grey = np.full((50, 60), 128, dtype=np.uint8)
    png = draw_marks(grey, (2, 3), "a.tif", ones)
    drawn = np.asarray(PIL.Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
    red = (drawn[:, :, 0] > 150) & (drawn[:, :, 2] < 60)
    assert red.any()
    assert png != draw_marks(grey, (2, 3), "b.tif", ones)
    page = measurements_page(data(*ones), "p", {"a.tif": png})
    assert "data:image/png;base64," in page
