import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.metrology.sizes.request_file import (
    parse_known_length,
    parse_place,
    parse_requests,
)

GOOD = """
[places]
left = "a.tif:512,300"
tip = "vertex:12"

[regions]
top = { disc = "a.tif:400,200", radius_px = 40 }
base = { polygon = ["a.tif:10,10", "a.tif:90,10", "a.tif:90,80"] }
plate = { union = ["base", { disc = "left", radius_px = 9 }] }
grain = { label = "specimen" }
all = { everything = true }

[measurements]
width = { distance = ["left", "b.tif:530.5,310"] }
step = { step_height = ["plate", "top"] }
ball = { sphere = "grain", diameter = true }
rim = { circle = ["left", "tip", "b.tif:1,2"] }
line = { profile = ["left", "a.tif:1,2"], samples = 11 }

[checks]
bar = { distance = ["left", "tip"], length = 5.0, sigma = 0.02 }

[scale_from]
distance = ["left", "tip"]
length = 5
"""


def test_a_file_is_read_as_it_is_written():
    found = parse_requests(GOOD, "m.toml")
    by_name = {one.name: one for one in found.measurements}
    assert str(by_name["width"]) == "distance of a.tif:512,300, b.tif:530.5,310"
    assert by_name["ball"].diameter
    assert [len(region.union) for region in by_name["step"].regions] == [2, 0]
    assert [str(p) for p in by_name["rim"].regions[0].places] == [
        "a.tif:512,300", "vertex:12", "b.tif:1,2",
    ]  # fmt: skip
    assert by_name["line"].samples == 11
    assert (found.checks[0].length, found.checks[0].sigma) == (5.0, 0.02)
    assert found.scale_from is not None
    assert found.scale_from.length == 5


WRONG = [
    ("[measurement]\n", r"m.toml, line 1: measurement: unknown section measurement \(did you mean"),
    ("x = [", "m.toml is not valid TOML"),
    ('[places]\na = "a.tif 5,3"\n', r"m.toml, line 2: places.a: no place is called a.tif 5,3"),
    ('[places]\na = "a.tif:5;3"\n', r"line 2: places.a: 'a.tif:5;3' is no place: write image:x,y"),
    ("[places]\na = 5\n", r"line 2: places.a: 5 is no place"),
    ("[regions]\n\nr = { disk = 1 }\n", r"line 3: regions.r must name one of disc, polygon"),
    (
        '[regions]\nr = { disc = "a:1,2" }\n',
        "line 2: regions.r: a disc needs radius_px, a positive",
    ),
    (
        '[regions]\nr = { polygon = ["a:1,2", "b:1,2", "a:3,3"] }\n',
        "line 2: regions.r: the corners of a polygon are places in one image",
    ),
    ('[regions]\nr = { union = ["r"] }\n', "line 2: regions.r: no region is called r"),
    (
        '[measurements]\nw = { distance = ["a:1,2"] }\n',
        "line 2: measurements.w: distance takes 2 of place, place, not 1",
    ),
    (
        '[measurements]\nw = { distance = ["a:1,2", "lefft"] }\n[places]\nleft = "a:1,2"\n',
        r"line 2: measurements.w: no place is called lefft \(did you mean left\?\)",
    ),
    ("[measurements.w]\nlength = 3\n", "m.toml, line 1: measurements.w must name one of distance"),
    (
        '[measurements]\nw = { sphere = "ball" }\n',
        "line 2: measurements.w: no region is called ball: define it below",
    ),
    (
        '[measurements]\nw = { distance = ["a:1,2", "a:2,3"], length = 3 }\n',
        "line 2: measurements.w: unknown key length",
    ),
    (
        '[checks]\nw = { distance = ["a:1,2", "a:2,3"] }\n',
        "line 2: checks.w: length = None, but a positive number is expected",
    ),
    (
        '[checks]\nw = { distance = ["a:1,2", "a:2,3"], length = -1 }\n',
        "line 2: checks.w: length = -1, but a positive",
    ),
    (
        '[scale_from]\nsphere = "r"\nlength = 2\n[regions]\nr = { everything = true }\n',
        "line 1: scale_from: a known length is one of a distance",
    ),
]


@pytest.mark.parametrize(("text", "message"), WRONG)
def test_what_is_wrong_is_said_with_its_line(text, message):
    with pytest.raises(UsageError, match=message):
        parse_requests(text, "m.toml")


@pytest.mark.parametrize("text", ["a.tif", "a.tif:1", "a.tif:1,b", "vertex:x", ":1,2", "vertex:-1"])
def test_what_is_no_place_is_refused(text):
    with pytest.raises(UsageError, match="is no place: write image:x,y"):
        parse_place(text, "--points")


def test_names_of_images_may_hold_colons():
    place = parse_place("C:/data/a.tif:1,2", "here")
    assert (place.image, place.xy) == ("C:/data/a.tif", (1.0, 2.0))


@pytest.mark.parametrize("text", ["a:1,2", "a:1,2,b:3,4", "a:1,2,b:3,4,five", "a:1,2,b:3,4,5,6,7"])
def test_what_is_no_known_length_is_refused(text):
    with pytest.raises(UsageError, match="expected two places and a length"):
        parse_known_length(text)


def test_a_known_length_is_positive():
    with pytest.raises(UsageError, match="a positive"):
        parse_known_length("a:1,2,b:3,4,-5")
