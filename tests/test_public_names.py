"""The names that a script imports."""

import inspect
import re

import pytest

import semsfm_colmap
from semsfm_colmap.config import Config, read_config, write_config


@pytest.mark.parametrize("name", semsfm_colmap.__all__)
def test_every_public_name_is_there_and_said_in_the_head_of_the_package(name):
    found = getattr(semsfm_colmap, name)
    if name != "__version__":
        assert f"`{name}`" in semsfm_colmap.__doc__
        assert inspect.getdoc(found)


@pytest.mark.parametrize("name", semsfm_colmap.__all__)
def test_a_path_may_be_a_string(name):
    found = getattr(semsfm_colmap, name)
    if not inspect.isroutine(found):
        return
    for parameter in inspect.signature(found).parameters.values():
        if re.search(r"\bPath\b", str(parameter.annotation)):
            assert "str" in str(parameter.annotation), parameter


def test_options_are_written_and_read_by_the_name_of_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_config(Config(seed=3), "options.toml")
    assert read_config("options.toml").seed == 3


def test_a_model_is_read_by_the_name_of_its_folder(small_project):
    model = semsfm_colmap.read_model(str(small_project / "sparse" / "0"))
    assert model.num_images == 7
