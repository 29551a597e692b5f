"""The conda recipe asks for what pyproject.toml does, under the names of conda-forge."""

from __future__ import annotations

import tomllib
from pathlib import Path

import yaml
from packaging.requirements import Requirement

from semsfm_colmap.version import __version__

ROOT = Path(__file__).parents[2]
CONDA_NAMES = {
    "matplotlib": "matplotlib-base",
    "open3d-cpu": "open3d",
    "opencv-python-headless": "py-opencv",
}
REWHEELED = {"py-opencv"}
"""conda-forge counts no builds of OpenCV as PyPI's wheels do: 4.10.0.84 is its 4.10.0."""


def test_the_recipe_asks_for_what_the_project_does():
    recipe = yaml.safe_load((ROOT / "recipe/recipe.yaml").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = {}
    # conda has no extras: what meshes need belongs to it
    meshes = project["optional-dependencies"].get("mesh", ())
    for text in (*project["dependencies"], *meshes):
        requirement = Requirement(text)
        asked[CONDA_NAMES.get(requirement.name, requirement.name)] = str(requirement.specifier)
    _, *run = recipe["requirements"]["run"]
    given = dict(line.split(" ", 1) for line in run)
    for name in REWHEELED & asked.keys():
        asked[name] = asked[name].rpartition(".")[0]
    assert given == asked
    assert recipe["context"]["version"] == __version__
    assert project["requires-python"] == f">={recipe['context']['python_min']}"
    assert recipe["build"]["python"]["entry_points"] == [
        f"{name} = {target}" for name, target in project["scripts"].items()
    ]


def test_the_citation_names_this_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == __version__
