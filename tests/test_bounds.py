"""Every option is fed what it must not be, from Python, TOML and flags."""

import math
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import get_args, get_origin, get_type_hints

import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.config import Config, config_from_dict
from semsfm_colmap.errors import UsageError
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.synthetic.options import SynthesizeOptions

SIGNED = {
    "tilt_step_deg", "first_octave", "exclusion_px", "min_correlation", "range_deg", "step_deg",
    "start_deg", "mount_deg", "secant_exponent", "magnification_drift", "degrees_per_um",
}  # fmt: skip
"""Options with a meaning below 0."""
ZERO_IS_NONE = ("spacing_px", "sweep_step_px", "max_error_px", "pixel_size_um", "seed", "rounds")


def options_of(kind):
    """(section, name, type as text) of every option."""
    for one in fields(kind):
        hint = get_type_hints(kind)[one.name]
        if is_dataclass(hint):
            yield from ((one.name, name, inner) for _, name, inner in options_of(hint))
        else:
            yield "", one.name, hint


def kinds_of(hint):
    """The plain types in a type."""
    return {hint} if get_origin(hint) is None else {k for a in get_args(hint) for k in kinds_of(a)}


def forbidden(name, hint):
    kinds = kinds_of(hint)
    if Path in kinds:
        return [3]
    if str in kinds:
        return [3.5]
    if bool in kinds:
        return ["perhaps"]
    if get_origin(hint) is tuple or any(get_origin(a) is tuple for a in get_args(hint)):
        return [(), "12", (math.nan,) * 4, (-1.0,) * 2]
    if not kinds & {int, float}:
        return ["no such choice", 3]
    values = ["some", math.nan, math.inf, -math.inf, [], "12"]
    values += [] if float in kinds else [1.5]
    values += [] if name in SIGNED else [-2]
    return values + ([0] if name in ZERO_IS_NONE and name != "seed" else [])


@pytest.mark.parametrize(("section", "name", "hint"), list(options_of(Config)))
def test_every_option_refuses_what_it_cannot_be(section, name, hint):
    config = Config()
    options = getattr(config, section) if section else config
    for value in forbidden(name, hint):
        with pytest.raises(UsageError, match=rf"{name}.* is .*: give"):
            replace(options, **{name: value})
        if value in ("12", 3, 3.5):
            continue  # pydantic reads numbers out of texts, which does no harm
        with pytest.raises(UsageError, match=name):
            config_from_dict({section: {name: value}} if section else {name: value})


@pytest.mark.parametrize(("section", "name", "hint"), list(options_of(SynthesizeOptions)))
def test_every_option_of_the_renderer_refuses_what_it_cannot_be(section, name, hint):
    for value in forbidden(name, hint):
        with pytest.raises(UsageError, match=rf"{name}.* is .*: give"):
            SynthesizeOptions(**{name: value})


@pytest.mark.parametrize(
    ("flag", "value"),
    [
        ("--seed", "-1"), ("--surface.spacing_px", "0"), ("--matching.max_error_px", "nan"),
        ("--pixel_size_um", "inf"), ("--pixel_size_um", "-0.1"), ("--num_threads", "0"),
        ("--guided.rounds", "-3"),
    ],
)  # fmt: skip
def test_a_flag_is_refused_before_anything_is_made(tmp_path, capsys, flag, value):
    images = tmp_path / "images"
    images.mkdir()
    project = tmp_path / "p"
    assert main(["reconstruct", str(images), "--output_path", str(project), flag, value]) == 2
    said = capsys.readouterr().err
    assert flag.rsplit(".", 1)[-1].removeprefix("--") in said
    assert said.count("\n") == 1
    assert not project.exists()


@pytest.mark.parametrize(
    "wrong", [{"max_error": 1}, {"max_error_px": 1.0}, None, 3, MatchingOptions]
)
def test_a_section_is_an_object_of_options(wrong):
    with pytest.raises(UsageError, match=r"matching is .*give MatchingOptions\(\.\.\.\)"):
        Config(matching=wrong)


def test_what_contradicts_another_option_is_said():
    config = Config()
    with pytest.raises(UsageError, match="crop"):
        replace(config.ingest, crop=(10, 0, 5, 9))
    with pytest.raises(UsageError, match="range_percentiles"):
        replace(config.ingest, range_percentiles=(99.0, 1.0))
    with pytest.raises(UsageError, match="max_block_images"):
        replace(config.factorization, min_block_images=5, max_block_images=4)


def test_numbers_of_numpy_and_lists_are_taken():
    import numpy as np

    options = replace(Config().refinement, filter_thresholds_px=[8, np.float64(2.0)])
    assert options.filter_thresholds_px == (8, 2.0)
    assert type(Config(seed=np.int64(3)).seed) is int
