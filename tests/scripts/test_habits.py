"""The files that set up and check agree with one another."""

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]


def test_every_package_that_is_asked_for_has_one_known_version_that_fits():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    asked = [*project["dependencies"], *(name for extra in extras for name in extra)]
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = [line.split("==") for line in lines if not line.startswith("#")]
    known = {canonicalize_name(name): version for name, version in pins}
    assert len(known) == len(pins)
    for requirement in map(Requirement, asked):
        if requirement.name == project["name"]:  # an extra of others
            continue
        # the versions are those of Linux on x86_64
        on = {"sys_platform": "linux", "platform_machine": "x86_64"}
        if requirement.marker is None or requirement.marker.evaluate(on):
            assert known[canonicalize_name(requirement.name)] in requirement.specifier


def test_the_hooks_run_every_piece_of_the_check():
    check = (ROOT / "scripts/check.sh").read_text()
    pieces = re.search(r"set -- (.*)", check)
    hooks = re.findall(r"check\.sh (\w+)", (ROOT / ".pre-commit-config.yaml").read_text())
    assert pieces is not None
    assert hooks == pieces.group(1).split()
