import inspect
from dataclasses import fields, is_dataclass, replace

import pytest

from semsfm_colmap.config import Config, config_from_dict, read_config, write_config
from semsfm_colmap.errors import UsageError


def test_a_configuration_comes_back_from_toml_as_it_was(tmp_path):
    config = Config(seed=3)
    config = replace(config, ingest=replace(config.ingest, pixel_size_um=0.05, crop=(0, 0, 10, 10)))
    write_config(config, tmp_path / "c.toml")
    assert read_config(tmp_path / "c.toml") == config


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"matchng": {}}, "did you mean matching"),
        ({"matching": {"overlap": "many"}}, "matching.overlap"),
        ({"matching": {"overlaps": 3}}, "did you mean matching.overlap"),
        ({"matching": 3}, "is a section"),
        ({"refinement": {"loss": "l1"}}, "refinement.loss"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(data, words):
    with pytest.raises(UsageError, match=words):
        config_from_dict(data)


def test_broken_toml_is_a_usage_error(tmp_path):
    (tmp_path / "c.toml").write_text("[matching")
    with pytest.raises(UsageError, match="not valid TOML"):
        read_config(tmp_path / "c.toml")


def test_every_option_is_documented_and_has_a_default():
    for section in fields(Config):
        default = getattr(Config(), section.name)
        if is_dataclass(default):
            lineage = [c for c in type(default).__mro__ if is_dataclass(c)]
            source = "".join(inspect.getsource(c) for c in lineage)
            for option in fields(default):
                after = source.split(f"\n    {option.name}:", 1)[1]
                assert '"""' in after.split("\n    def ")[0], option.name


def test_a_value_of_an_older_version_is_read_under_its_name_of_now(tmp_path):
    file = tmp_path / "old.toml"
    file.write_text('[surface]\nmethod = "ball_pivoting"\n')
    assert read_config(file).surface.method == "ball-pivoting"
    file.write_text('[surface]\nmethod = "ball_rolling"\n')
    with pytest.raises(UsageError, match="ball-pivoting"):
        read_config(file)
