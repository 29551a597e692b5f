"""Every option is fed what it must not be, from Python, TOML and flags."""

import math
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import get_args, get_origin, get_type_hints

import pytest

from semsfm_colmap.cli.commands import COMMANDS
from semsfm_colmap.cli.common import described
from semsfm_colmap.cli.flags import flags_of
from semsfm_colmap.cli.main import main
from semsfm_colmap.config import Config, config_from_dict
from semsfm_colmap.errors import UsageError
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.metrology.heights.height_map_options import HeightMapOptions
from semsfm_colmap.planning.options import NoiseOptions, SpecimenOptions
from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.studies.features.options import StudyOptions
from semsfm_colmap.synthetic.options import SynthesizeOptions

SIGNED = {
    "tilt_step_deg", "first_octave", "exclusion_px", "min_correlation", "range_deg", "step_deg",
    "start_deg", "mount_deg", "secant_exponent", "magnification_drift", "degrees_per_um",
    "from_deg", "to_deg",
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


def options_beside_the_configuration():
    """The dataclasses of options that commands have besides `Config`."""
    found = {}
    for command in COMMANDS:
        kind = described(command.main())
        for hint in get_type_hints(kind).values():
            if is_dataclass(hint) and hint is not Config:
                found[hint.__name__] = hint
    return sorted({**found, "NoiseOptions": NoiseOptions, "ReportOptions": ReportOptions}.items())


@pytest.mark.parametrize(
    ("kind", "name", "hint"),
    [
        (kind, name, hint)
        for _, kind in options_beside_the_configuration()
        for _, name, hint in options_of(kind)
    ],
)
def test_every_option_of_other_commands_refuses_what_it_cannot_be(kind, name, hint):
    for value in forbidden(name, hint):
        with pytest.raises(UsageError, match=rf"{name}.* is .*: give"):
            kind(**{name: value})


@pytest.mark.parametrize("command", [command.name for command in COMMANDS])
@pytest.mark.parametrize("value", ["nan", "inf", "-1"])
def test_numbers_of_commands_themselves_are_refused_in_one_sentence(
    tmp_path, capsys, command, value
):
    kind = described(next(c for c in COMMANDS if c.name == command).main())
    own = {one.name for one in fields(kind) if not is_dataclass(get_type_hints(kind)[one.name])}
    flags = list(flags_of(kind))
    wrong = {"NUMBER", "INTEGER"} if value == "-1" else {"NUMBER"}
    numbers = [
        flag
        for flag in flags
        if flag.name.removeprefix("--") in own and wrong & set(flag.values.split())
    ]
    needed = [flag for flag in flags if flag.required]
    for number in numbers:
        given = []
        for flag in needed:
            value_of = "ply" if flag.name == "--to" else str(tmp_path / "some")
            given += [value_of] if flag.is_positional else [flag.name, value_of]
        count = max(len(number.values.removesuffix(" ...").split()), 1)
        if value == "-1" and count > 1:
            continue  # places may have any sign
        assert main([command, *given, number.name, *[value] * count]) == 2, number
        said = capsys.readouterr().err
        assert number.name.removeprefix("--") in said, said
        assert "not a folder" not in said, said


@pytest.mark.parametrize(
    "make",
    [
        lambda: FormatOptions(max_deviation_px=0, focal_factor=0, fusion_consistency_px=0),
        lambda: FormatOptions(max_fiducials=0, max_source_angle_deg=0),
        lambda: NoiseOptions(drift_sigma_px=0),
        lambda: SpecimenOptions(max_total_deg=360),
        lambda: HeightMapOptions(pixel_size_sigma=0, seed=0),
        lambda: StudyOptions(max_num_pairs=0, overlap_px=0, exclusion_px=0),
        lambda: ReportOptions(max_scene_points=0, max_scene_faces=0, max_pair_rows=0),
        lambda: SynthesizeOptions(start_deg=0, magnification_drift=0),
    ],
)
def test_a_zero_that_means_something_is_taken(make):
    make()


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
