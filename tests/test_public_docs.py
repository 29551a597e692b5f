"""What is public says what it takes, what it returns and what it raises."""

import builtins
import importlib.util
import inspect
import re
from dataclasses import fields, is_dataclass
from pathlib import Path

import griffe
import pytest

import semsfm_colmap
from semsfm_colmap import errors
from semsfm_colmap.config import Config

ROOT = Path(__file__).parents[1]
NAMES = [name for name in semsfm_colmap.__all__ if name != "__version__"]
FUNCTIONS = [name for name in NAMES if inspect.isroutine(getattr(semsfm_colmap, name))]
NEVER_RAISE = {"map_observations": "its Solution says why there is no value"}


def script(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / f"scripts/{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


house = script("house_docstrings")
TYPES = sorted(
    name
    for name, found in vars(importlib.import_module("semsfm_colmap.types")).items()
    if is_dataclass(found)
)


def sections_of(function):
    return dict(house.sections(inspect.getdoc(function) or ""))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_parameter_of_a_public_function_is_explained(name):
    function = getattr(semsfm_colmap, name)
    said = house.entries(sections_of(function)["Parameters"])
    assert all(words for _, words in said)
    explained = [one for names, _ in said for one in names.split(", ")]
    assert sorted(explained) == sorted(inspect.signature(function).parameters)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_says_what_it_returns(name):
    function = getattr(semsfm_colmap, name)
    returns = inspect.signature(function).return_annotation
    assert ("Returns" in sections_of(function)) == (returns != "None")


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_says_which_errors_it_raises_and_when(name):
    text = sections_of(getattr(semsfm_colmap, name)).get("Raises", "")
    assert (not text) == (name in NEVER_RAISE)
    for kind, when in house.entries(text):
        found = getattr(errors, kind, None) or getattr(builtins, kind)
        assert issubclass(found, Exception)
        assert when


@pytest.mark.parametrize("name", TYPES)
def test_every_method_of_a_public_type_explains_what_it_takes(name):
    kind = getattr(semsfm_colmap.types, name)
    assert inspect.getdoc(kind)
    for attribute, found in vars(kind).items():
        if attribute.startswith("_"):
            continue
        function = found.fget if isinstance(found, property) else found
        if not inspect.isfunction(function):
            continue
        text = inspect.getdoc(function)
        assert text, f"{name}.{attribute}"
        for parameter in list(inspect.signature(function).parameters)[1:]:
            assert re.search(rf"\b{parameter}\b", text), f"{name}.{attribute}: {parameter}"


def test_every_option_of_the_configuration_is_explained():
    package = griffe.load("semsfm_colmap", search_paths=[str(ROOT)])

    def explained(kind, name):
        homes = [base for base in kind.__mro__ if name in vars(base).get("__annotations__", {})]
        path = f"{homes[0].__module__}.{homes[0].__name__}".removeprefix("semsfm_colmap.")
        return package[path].members[name].docstring is not None

    for section in fields(Config):
        assert explained(Config, section.name)
        value = getattr(Config(), section.name)
        if is_dataclass(value):
            missing = [f.name for f in fields(value) if not explained(type(value), f.name)]
            assert missing == [], f"[{section.name}]"


def test_house_docstrings_become_numpydoc():
    text = (
        "Head.\n\nParameters\n----------\na, b : first line\n    second line\n\n"
        "Returns\n-------\nwords"
    )
    assert house.numpydoc(text, "int") == (
        "Head.\n\nParameters\n----------\na, b\n    first line second line\n\n"
        "Returns\n-------\nint\n    words"
    )
