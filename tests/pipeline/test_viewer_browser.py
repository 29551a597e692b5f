"""The viewer in a browser: what it draws, what it measures, that nothing leaves the page."""

from __future__ import annotations

import io
import shutil
import threading

import numpy as np
import PIL.Image
import pytest

import semsfm_colmap
from semsfm_colmap.metrology.sizes.budget import FOLDED
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.view import make_server
from tests.browser import chromium, opened

pytestmark = pytest.mark.slow

PART = """(name) => document.querySelector('#viewer [data-part="' + name + '"]')"""
PICK_AT_VERTEX = """(id) => {
  const { state, project, pick } = semsfm.viewer, { arrays } = state.scene;
  const k = Array.prototype.indexOf.call(arrays["place.id"], id);
  const [x, y] = project(Array.from(arrays["place.position"].subarray(3 * k, 3 * k + 3)));
  pick(x, y);
  return state.places.map((place) => place.id);
}"""
NAMELESS = """() => [...document.querySelectorAll("#viewer :is(button, select, input, [tabindex])")]
  .filter((e) => {
    const label = e.labels && e.labels.length ? e.labels[0].textContent : "";
    const own = e.matches("button") ? e.textContent : e.getAttribute("aria-label") || "";
    return !(own.trim() || label.trim());
  })
  .map((e) => e.outerHTML)"""
SCALE_BAR = "() => { semsfm.viewer.draw(); return semsfm.viewer.scaleBar; }"
RESULTS = "() => semsfm.viewer.state.results"


@pytest.fixture(scope="module")
def project(small_project, tmp_path_factory):
    chromium()
    path = tmp_path_factory.mktemp("drawn") / "p"
    shutil.copytree(small_project, path)
    return path


@pytest.fixture(scope="module")
def address(project):
    """Of the report."""
    return (project / "report" / "report.html").resolve().as_uri()


@pytest.fixture
def shown(address):
    with opened(address, width=1000, height=900) as watched:
        ready(watched.page)
        yield watched
        assert watched.complaints == []
        assert watched.requests == [address]


def ready(page):
    """Wait for the first picture, and for the texture, which comes after it."""
    page.wait_for_selector("#viewer.drawn", timeout=60_000)
    for _ in range(100):
        if page.evaluate(
            "() => semsfm.viewer.state.drawing.layers.every(l => l.textured || !l.pictured)"
        ):
            break
        page.wait_for_timeout(50)
    page.wait_for_timeout(500)


def control(page, name, value):
    """Set a select or a slider as a person does."""
    page.evaluate(
        f"""([name, value]) => {{
          const part = ({PART})(name);
          part.value = value;
          for (const kind of ["input", "change"]) {{ part.dispatchEvent(new Event(kind)); }}
        }}""",
        [name, value],
    )
    page.wait_for_timeout(300)


def canvas(page):
    """Pixels of the drawing itself, without what is written over it."""
    page.add_style_tag(content='[data-part="overlay"] { visibility: hidden; }')
    png = page.locator('#viewer [data-part="canvas"]').screenshot()
    return np.asarray(PIL.Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def covered(pixels):
    """Share of the picture that is not ground."""
    return float(np.mean(np.abs(pixels - pixels[2, 2]).sum(axis=2) > 30))


def hide(page, *labels):
    for label in labels:
        page.get_by_label(label, exact=True).uncheck()
    page.wait_for_timeout(300)


def visible_vertices(page):
    """Two vertices in the middle of the picture that no other part hides."""
    found = page.evaluate(
        """() => {
          const v = semsfm.viewer, c = document.querySelector('#viewer [data-part="canvas"]');
          v.pick(0.47 * c.clientWidth, 0.48 * c.clientHeight);
          v.pick(0.53 * c.clientWidth, 0.53 * c.clientHeight);
          return v.state.places.map((place) => place.id);
        }"""
    )
    page.get_by_role("button", name="clear").click()
    assert len(found) == 2
    return found


def test_the_surface_is_drawn_with_its_texture(shown):
    page = shown.page
    hide(page, "cameras", "rotation axis")
    textured = canvas(page)
    assert 0.05 < covered(textured) < 0.9
    control(page, "color", "plain")
    plain = canvas(page)
    # the same outline, another inside: grey that follows the images and not the light
    both = (np.abs(textured - textured[2, 2]).sum(axis=2) > 30) & (
        np.abs(plain - plain[2, 2]).sum(axis=2) > 30
    )
    assert both.mean() > 0.8 * covered(textured)
    assert np.abs(textured - plain)[both].mean() > 10


def test_colours_follow_the_values_and_have_a_legend(shown):
    page = shown.page
    hide(page, "cameras", "rotation axis")
    for key in ("height", "sigma", "views"):
        control(page, "color", key)
        pixels = canvas(page)
        drawn = pixels[np.abs(pixels - pixels[2, 2]).sum(axis=2) > 30]
        # grey has no chroma, viridis much
        assert np.ptp(drawn, axis=1).mean() > 30
        legend = page.evaluate("() => semsfm.viewer.state.drawing.legend")
        assert legend["low"] < legend["high"]
    assert legend["title"] == "images that see it"


def test_the_scale_bar_follows_the_zoom(shown):
    page = shown.page
    before = page.evaluate(SCALE_BAR)
    page.locator('#viewer [data-part="canvas"]').focus()
    for _ in range(12):
        page.keyboard.press("+")
    page.wait_for_timeout(200)
    after = page.evaluate(SCALE_BAR)
    per_px = [bar["length"] / bar["px"] for bar in (before, after)]
    assert per_px[0] / per_px[1] == pytest.approx(1.15**12, rel=1e-6)


def test_a_length_picked_in_the_page_is_that_of_measure(shown, project):
    page = shown.page
    a, b = visible_vertices(page)
    page.evaluate(PICK_AT_VERTEX, a)
    assert page.evaluate(PICK_AT_VERTEX, b) == [a, b]
    (length,) = page.evaluate(RESULTS)
    (known,) = semsfm_colmap.measure(project, points=[f"vertex:{a}", f"vertex:{b}"])
    assert length["value"] == pytest.approx(known.value, rel=1e-6)
    assert length["sigma"] == pytest.approx(known.sigma, rel=0.02)
    text = page.locator('[data-part="readout"]').inner_text()
    assert f"semsfm measure PROJECT --points vertex:{a} vertex:{b}" in text
    cameras = [source.contribution for source in known.sources if "cameras" in source.name]
    shown_sources = dict(length["sources"])
    assert shown_sources["cameras"] == pytest.approx(np.linalg.norm(cameras), rel=0.02)
    for source in known.sources:
        if source.name in shown_sources:
            assert shown_sources[source.name] == pytest.approx(source.contribution, rel=0.02)


def test_the_page_says_of_an_angle_that_may_be_none_what_measure_says(shown):
    remarks = shown.page.evaluate(
        """() => {
          const { scene } = semsfm.viewer.state, all = Uint8Array.from([255, 255, 255, 255]);
          const at = (x, z) => ({ point: [x, 0, z], normal: [0, 0, -1], sigma: 5, seen: all });
          return semsfm.measure(scene, [at(0, 0), at(1, 0.001), at(2, 0)])[1].remarks;
        }"""
    )
    assert remarks == [FOLDED]


def test_an_angle_is_measured_by_keys_alone(shown, project):
    page = shown.page
    three = page.evaluate(
        "() => [10, 500, 200].map(k => semsfm.viewer.state.scene.arrays['place.id'][k])"
    )
    field = page.get_by_label("vertex", exact=True)
    for vertex in three:
        field.fill(str(vertex))
        field.press("Enter")
    page.wait_for_timeout(200)
    _, angle = page.evaluate(RESULTS)
    found = semsfm_colmap.measure(project, points=[f"vertex:{v}" for v in three])
    assert angle["value"] == pytest.approx(found[1].value, rel=1e-5)
    assert angle["sigma"] == pytest.approx(found[1].sigma, rel=0.02)
    page.locator('#viewer [data-part="canvas"]').focus()
    page.keyboard.press("Escape")
    assert page.locator('[data-part="readout"]').inner_text() == ""
    page.keyboard.press("m")
    page.keyboard.press("Enter")
    assert len(page.evaluate("() => semsfm.viewer.state.places")) == 1


def test_a_section_takes_a_part_away(shown):
    page = shown.page
    hide(page, "cameras", "rotation axis")
    whole = covered(canvas(page))
    control(page, "cut", "x")
    half = covered(canvas(page))
    page.get_by_label("other side").check()
    page.wait_for_timeout(300)
    other = covered(canvas(page))
    assert half < 0.9 * whole
    assert other < 0.9 * whole
    # the two halves are all of it, but for what one hides of the other
    assert half + other >= 0.95 * whole
    assert "µm" in page.locator('[data-part="cut-text"]').inner_text()


def test_through_a_camera_the_image_lies_over_the_surface(shown, project):
    page = shown.page
    hide(page, "rotation axis")
    control(page, "frame", "3")
    control(page, "blend", "1")
    picture = canvas(page)
    control(page, "blend", "0")
    surface = canvas(page)
    name = page.evaluate("() => semsfm.viewer.state.scene.header.frames[3].name")
    image = np.asarray(PIL.Image.open(Project(project).images / name)).astype(float)
    corners = page.evaluate(
        """() => [0, 2].map((c) => semsfm.viewer.project(
             semsfm.viewer.state.scene.arrays["frame.corner"].subarray(36 + 3 * c, 39 + 3 * c)))"""
    )
    (x0, y0), (x1, y1) = corners
    rows = ((np.arange(picture.shape[0]) - y0) / (y1 - y0) * image.shape[0]).astype(int)
    columns = ((np.arange(picture.shape[1]) - x0) / (x1 - x0) * image.shape[1]).astype(int)
    r = (rows >= 4) & (rows < image.shape[0] - 4)
    c = (columns >= 4) & (columns < image.shape[1] - 4)
    expected = image[np.ix_(rows[r], columns[c])]
    seen = picture[np.ix_(r, c)].mean(axis=2)
    assert np.corrcoef(seen.ravel(), expected.ravel())[0, 1] > 0.97
    # the textured surface is where the image shows it
    grey = surface[np.ix_(r, c)].mean(axis=2)
    drawn = np.abs(surface - surface[2, 2]).sum(axis=2)[np.ix_(r, c)] > 30

    def agreement(shift):
        both = drawn & np.roll(drawn, shift, axis=(0, 1))
        return np.corrcoef(np.roll(grey, shift, axis=(0, 1))[both], expected[both])[0, 1]

    away = [agreement((dy, dx)) for dy, dx in ((12, 0), (-12, 0), (0, 12), (0, -12))]
    assert agreement((0, 0)) > max(away) + 0.1


def test_a_picture_is_saved_with_its_scale_bar(shown):
    page = shown.page
    with page.expect_download() as download:
        page.get_by_role("button", name="save as PNG").click()
    saved = np.asarray(PIL.Image.open(download.value.path()).convert("RGB")).astype(int)
    assert download.value.suggested_filename.endswith(".png")
    assert covered(saved) > 0.05
    bar = page.evaluate(SCALE_BAR)
    line = np.abs(saved[-13] - saved[2, 2]).sum(axis=1) > 200
    assert line[: saved.shape[1] // 2].sum() == pytest.approx(bar["px"], abs=4)


def test_every_control_has_a_name_and_nothing_is_wider_than_a_telephone(address):
    with opened(address, width=400, height=800, dark=True) as watched:
        page = watched.page
        ready(page)
        nameless = page.evaluate(NAMELESS)
        assert nameless == []
        width = page.evaluate(
            """() => Math.max(...[...document.querySelectorAll("#viewer *")]
              .map((e) => e.getBoundingClientRect().right))"""
        )
        assert width <= 400
        assert watched.complaints == []
        dark = canvas(page)
    assert dark[2, 2].mean() < 60


def test_without_webgl_a_still_picture_is_shown(address):
    with opened(address, flags=("--no-sandbox", "--disable-gpu", "--disable-3d-apis")) as watched:
        page = watched.page
        page.wait_for_selector("#viewer.still")
        assert page.locator(".viewer-still img").is_visible()
        assert not page.locator(".viewer-controls").is_visible()
        assert "no WebGL" in page.locator('[data-part="message"]').inner_text()


def test_on_paper_there_is_a_still_picture(shown):
    shown.page.emulate_media(media="print")
    assert shown.page.locator(".viewer-still img").is_visible()
    assert not shown.page.locator(".viewer-stage").is_visible()


def test_beside_its_server_the_viewer_measures_and_sees_what_comes(small_project, tmp_path):
    path = tmp_path / "p"
    shutil.copytree(small_project, path)
    (path / "mesh").rename(tmp_path / "mesh")
    server = make_server(path)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        with opened(server.address) as watched:
            page = watched.page
            ready(page)
            assert page.get_by_label("mesh", exact=True).count() == 0
            (tmp_path / "mesh").rename(path / "mesh")
            page.get_by_label("mesh", exact=True).wait_for(timeout=20_000)
            ready(page)
            page.evaluate("() => { semsfm.viewer.addVertex(5); semsfm.viewer.addVertex(900); }")
            page.get_by_text("length:").wait_for(timeout=60_000)
            (length,) = page.evaluate(RESULTS)
            assert watched.complaints == []
            assert all(url.startswith(server.address) for url in watched.requests)
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
    (known,) = semsfm_colmap.measure(path, points=["vertex:5", "vertex:900"])
    assert (length["value"], length["sigma"]) == (known.value, known.sigma)
