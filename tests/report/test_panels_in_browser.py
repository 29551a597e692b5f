"""The panels of the images and the viewer of pairs in a browser: every control does its work."""

import pytest

from tests.browser import opened

pytestmark = pytest.mark.slow

SETTLE_MS = 600
INK = """(id) => {
  const c = document.getElementById(id);
  const rgba = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
  let sum = 0;
  for (let k = 0; k < rgba.length; k += 4) {
    sum = (sum * 31 + rgba[k] + 3 * rgba[k + 1] + 7 * rgba[k + 2] + 11 * rgba[k + 3]) % 1e9;
  }
  return sum;
}"""


@pytest.fixture(scope="module")
def desk(full_page):
    """The page, open on a desk's screen."""
    with opened(full_page, width=1400, height=1000) as watched:
        watched.page.wait_for_timeout(SETTLE_MS)
        yield watched.page


def ink(page, canvas):
    page.wait_for_timeout(60)
    return page.evaluate(INK, canvas)


def test_a_thumbnail_shows_the_panel_of_its_image(desk):
    desk.locator("#strip button").nth(2).click()
    assert desk.locator("#panel-title").text_content() == "Frame 3: frame_002.png"
    assert desk.locator('#strip button[aria-pressed="true"]').count() == 1
    desk.locator("#after").click()
    assert desk.locator("#panel-title").text_content() == "Frame 4: frame_003.png"
    desk.locator("#before").press("Enter")
    assert "Frame 3" in desk.locator("#panel-title").text_content()
    desk.locator("#strip button").last.click()
    assert "not registered" in desk.locator("#panel-facts").text_content()


def test_every_control_of_the_panel_changes_what_is_drawn(desk):
    desk.locator("#strip button").nth(2).click()
    before = ink(desk, "overlay")
    for label in ("their scale and orientation", "residuals × 50", "tracks", "kept"):
        desk.get_by_label(label, exact=label != "kept").first.click()
        after = ink(desk, "overlay")
        assert after != before, label
        before = after
    assert "50 times longer" in desk.locator("#panel-hint").text_content()
    desk.locator("#reach").fill("1")
    assert ink(desk, "overlay") != before
    desk.locator("#zoom").select_option("2")
    stack, view = (desk.locator(s).bounding_box()["width"] for s in ("#stack", "#view"))
    assert stack == pytest.approx(2.0 * view, rel=0.03)
    desk.locator("#zoom").select_option("1")


def test_the_mesh_lies_over_the_image_with_wipe_and_blink(desk):
    desk.locator("#strip button").nth(1).click()
    second = desk.locator("#second")
    assert not second.is_visible()
    desk.get_by_label("mesh over the image").check()
    assert second.is_visible()
    assert second.evaluate("(e) => e.naturalWidth") > 100
    desk.locator("#wipe").fill("20")
    assert "80%" in second.evaluate("(e) => e.style.clipPath")
    desk.locator("#blink").click()
    seen = set()
    for _ in range(8):
        seen.add(second.evaluate("(e) => e.style.visibility"))
        desk.wait_for_timeout(200)
    assert seen == {"", "hidden"}
    desk.locator("#blink").click()
    desk.get_by_label("depth map").check()
    assert desk.locator("#color-bar").is_visible()
    assert "µm" in desk.locator("#color-high").text_content()
    # the last registered image has no depth map, the lost one no mesh
    desk.locator("#strip button").nth(5).click()
    assert desk.get_by_label("depth map").is_disabled()
    assert not second.is_visible()


def distances(page):
    text = page.locator("#pair-facts").text_content()
    return [float(word) for word, unit in zip(text.split(), text.split()[1:], strict=False)
            if unit == "px" and word.replace(".", "").isdigit()]  # fmt: skip


def test_epipolar_lines_pass_through_the_match_of_a_point(desk):
    for _ in range(3):
        desk.locator("#next-match").click()
        assert "The match (ring) lies" in desk.locator("#pair-facts").text_content()
        # places are fractions of 65535: a hundredth of a pixel
        assert len(distances(desk)) == 2
        assert max(distances(desk)) <= 0.03


def test_the_geometry_holds_with_the_images_exchanged(desk):
    left, right = desk.locator("#pair-0"), desk.locator("#pair-1")
    left.select_option("3")
    right.select_option("2")
    desk.locator("#next-match").click()
    assert len(distances(desk)) == 2
    assert max(distances(desk)) <= 0.03


def test_a_click_or_the_arrow_keys_set_a_point_and_draw_its_line(desk):
    desk.locator("#pair-0").select_option("0")
    desk.locator("#pair-1").select_option("1")
    before = ink(desk, "pair-overlay")
    desk.locator("#side-1").click(position={"x": 150, "y": 120})
    text = desk.locator("#pair-facts").text_content()
    assert "in the right image" in text
    assert "Yellow" in text
    assert "Blue, dashed" in text
    clicked = ink(desk, "pair-overlay")
    assert clicked != before
    desk.locator("#side-1").press("ArrowRight")
    assert ink(desk, "pair-overlay") != clicked
    desk.locator("#side-0").press("Shift+ArrowDown")
    assert "Point (320.0, 241.0) px in the left image" in desk.locator("#pair-facts").text_content()


def test_a_pair_that_was_not_matched_has_the_line_of_the_model(desk):
    desk.locator("#pair-0").select_option("0")
    desk.locator("#pair-1").select_option("4")
    desk.locator("#side-0").click(position={"x": 150, "y": 120})
    text = desk.locator("#pair-facts").text_content()
    assert "not matched" in text
    assert "Blue, dashed" in text
    assert "Yellow" not in text
    desk.locator("#pair-after").click()
    assert "matches verified" in desk.locator("#pair-facts").text_content()


def test_every_control_is_reached_by_the_keyboard(desk):
    desk.locator("h1").click()
    desk.evaluate("document.activeElement.blur(); window.scrollTo(0, 0)")
    reached = set()
    for _ in range(140):
        desk.keyboard.press("Tab")
        reached.add(desk.evaluate("document.activeElement.id || document.activeElement.className"))
    for wanted in (
        "skip", "before", "after", "zoom", "reach", "view", "pair-0", "pair-1", "pair-before",
        "pair-after", "next-match", "side-0", "side-1", "table",
    ):  # fmt: skip
        assert wanted in reached, wanted
