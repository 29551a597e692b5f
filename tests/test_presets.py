"""The qualities: what they set, and what stands above them."""

from dataclasses import asdict, replace

import pytest

from semsfm_colmap.cli.common import file_config, parse, with_default_config
from semsfm_colmap.cli.reconstruct import Arguments
from semsfm_colmap.config import Config, config_from_dict, preset, read_config, write_config
from semsfm_colmap.errors import UsageError
from semsfm_colmap.presets import PRESETS, QUALITIES


def parsed(*flags, project=None):
    command = with_default_config(Arguments, file_config(flags, project))
    return parse(command, ["images", "--output_path", "p", *flags], "reconstruct", "").config


def test_high_is_the_default_and_every_other_one_is_something_else():
    assert preset("high") == Config() == parsed()
    found = [preset(quality) for quality in QUALITIES]
    assert [config.quality for config in found] == list(QUALITIES)
    assert len({repr(replace(config, quality="high")) for config in found}) == len(QUALITIES)


@pytest.mark.parametrize("quality", QUALITIES)
def test_a_preset_sets_what_it_says_and_nothing_that_is_the_default_anyway(quality):
    config, usual = asdict(preset(quality)), asdict(Config())
    for section, options in PRESETS[quality].items():
        for name, value in options.items():
            assert config[section][name] == value != usual[section][name]
            usual[section][name] = value
    usual["quality"] = quality
    assert config == usual


def test_work_grows_with_the_quality():
    sizes = [preset(quality) for quality in QUALITIES]
    for number in (
        [c.features.max_num_features for c in sizes],
        [c.guided.rounds for c in sizes],
        [c.surface.max_depth_map_size_px for c in sizes],
        [c.surface.max_num_depth_maps for c in sizes],
    ):
        assert number == sorted(number)


def test_flags_and_files_stand_above_the_quality(tmp_path):
    assert parsed("--quality", "low") == preset("low")
    config = parsed("--quality=low", "--guided.rounds", "4")
    assert (config.guided.rounds, config.guided.fill_up_to) == (4, 0)
    file = tmp_path / "options.toml"
    # a value that is the default is a word too
    file.write_text("[features]\nmax_num_features = 8192\n")
    config = parsed("--quality", "low", "--config_path", str(file))
    assert (config.features.max_num_features, config.features.first_octave) == (8192, 0)
    file.write_text('quality = "low"\n[guided]\nrounds = 4\n')
    config = parsed("--config_path", str(file))
    assert (config.quality, config.guided.rounds, config.guided.fill_up_to) == ("low", 4, 0)


def test_a_project_remembers_its_quality_and_another_one_keeps_the_users_options(tmp_path):
    config = parsed("--quality", "low", "--matching.overlap", "3")
    write_config(config, tmp_path / "semsfm.toml")
    assert file_config([], tmp_path) == config
    higher = file_config(["--quality", "extreme"], tmp_path)
    assert higher.matching.overlap == 3
    assert replace(higher, matching=preset("extreme").matching) == preset("extreme")


def test_a_project_of_an_older_version_takes_another_quality_too(tmp_path):
    write_config(Config(seed=5), tmp_path / "semsfm.toml")
    text = (tmp_path / "semsfm.toml").read_text().replace('quality = "high"\n', "")
    assert "quality" not in text
    (tmp_path / "semsfm.toml").write_text(text)
    assert file_config([], tmp_path) == Config(seed=5)
    assert file_config(["--quality", "low"], tmp_path) == replace(preset("low"), seed=5)


def test_a_quality_that_is_not_there_is_refused(tmp_path, capsys):
    with pytest.raises(UsageError, match="best"):
        preset("best")
    with pytest.raises(UsageError, match="quality"):
        config_from_dict({"quality": "best"})
    with pytest.raises(SystemExit) as stop:
        parsed("--quality", "best")
    assert stop.value.code == 2
    file = tmp_path / "options.toml"
    file.write_text("[guided]\nroundz = 4\n")
    with pytest.raises(UsageError, match=r"did you mean guided\.rounds"):
        read_config(file, "low")
