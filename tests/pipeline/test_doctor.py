"""The doctor on this installation, and on ones that lack something."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.io.extras import EXTRAS
from semsfm_colmap.pipeline import doctor
from semsfm_colmap.pipeline.doctor import (
    Finding,
    cure_of,
    libraries,
    lines_of,
    look_at_library,
    memory_gb,
    system_packages,
)


def fake(stderr, returncode=1):
    return lambda *arguments, **options: SimpleNamespace(
        returncode=returncode, stderr=stderr, stdout=""
    )


def test_the_libraries_are_those_of_this_machine_and_of_the_extras():
    core, mesh = libraries(), libraries("mesh")
    assert {"numpy", "pycolmap", "tyro"} <= set(core)
    assert len({"open3d", "open3d-cpu"} & set(mesh)) == 1
    assert "pytest" not in (*core, *mesh)
    assert not set(core) & set(mesh)
    table = tomllib.loads((Path(doctor.__file__).parents[2] / "pyproject.toml").read_text())
    assert len(core) == len(table["project"]["dependencies"])
    extras = table["project"]["optional-dependencies"]
    assert len(mesh) == len(extras["mesh"]) - 1  # open3d has two names
    assert set(EXTRAS) < set(extras)


def test_an_extra_that_was_not_asked_for_is_said_and_is_no_fault(monkeypatch, tmp_path):
    quick(monkeypatch, Finding(name="a", state="good", found="1.0"))
    monkeypatch.setattr(doctor, "EXTRAS", {"mesh": "no_such_module"})
    found = doctor.examine(tmp_path)
    (absent,) = (f for f in found.findings if f.state == "absent")
    assert 'pip install "semsfm-colmap[mesh]"' in absent.cure
    assert found.is_content


def test_the_libraries_of_an_extra_that_is_there_are_looked_at(monkeypatch, tmp_path):
    names = {"": ("a",), "mesh": ("b",)}
    monkeypatch.setattr(doctor, "EXTRAS", {"mesh": "json"})
    monkeypatch.setattr(doctor, "libraries", lambda extra="": names[extra])
    monkeypatch.setattr(
        doctor, "look_at_library", lambda name: Finding(name=name, state="bad", found="broken")
    )
    found = doctor.examine(tmp_path)
    assert [f.name for f in found.findings if f.state == "bad"] == ["a", "b"]
    assert not found.is_content


@pytest.mark.parametrize(
    ("reason", "package"),
    [
        ("ImportError: libGL.so.1: cannot open shared object file: No such file", "libgl1"),
        ("OSError: libgomp.so.1: cannot open shared object file: No such file", "libgomp1"),
        ("OSError: libusb-1.0.so.0: cannot open shared object file", "libusb-1.0-0"),
        ("OSError: libX11.so.6: cannot open shared object file", "libx11-6"),
    ],
)
def test_a_missing_shared_object_names_the_package_that_has_it(reason, package):
    assert cure_of(reason).endswith(f"apt-get install {package}")
    finding = look_at_library("open3d-cpu", fake(f"Traceback\n{reason}\n"))
    assert finding.state == "bad"
    assert "does not load" in finding.found
    assert system_packages([finding, finding]) == [package]


@pytest.mark.skipif(sys.platform != "linux", reason="its name is that of Linux")
def test_numba_without_openmp_is_a_fault_though_it_can_be_imported():
    def run(command, **options):
        said = "ImportError: libgomp.so.1.0.0: cannot open shared object file: No such file"
        lacking = command[0] != "ldd" and "omppool" in command[-1]
        return SimpleNamespace(
            returncode=int(lacking), stderr=said, stdout="\tlibtbb.so.12 => not found"
        )

    finding = look_at_library("numba", run)
    assert finding.state == "bad"
    assert system_packages([finding]) == ["libgomp1"]


@pytest.mark.skipif(sys.platform != "linux", reason="ldd is of Linux")
def test_all_that_is_missing_is_named_at_once_and_what_the_wheel_has_itself_is_not():
    said = "libGL.so.1: cannot open shared object file: No such file or directory"

    def run(command, **options):
        if command[0] != "ldd":
            return SimpleNamespace(returncode=1, stderr=f"ImportError: {said}", stdout="")
        own = Path(command[1]).name
        lines = ("libGL.so.1 => not found", "libgomp.so.1 => not found",
                 "libtorch_cpu.so => not found", f"{own} => not found",
                 "libc.so.6 => /lib/libc.so.6 (0x1)", "libGL.so.1 => not found")  # fmt: skip
        return SimpleNamespace(returncode=0, stderr="", stdout="\n\t".join(("", *lines)))

    finding = look_at_library("numpy", run)
    assert finding.cure.endswith("apt-get install libgl1 libgomp1")
    assert system_packages([finding]) == ["libgl1", "libgomp1"]


def test_an_object_that_nobody_knows_is_to_be_searched_for_and_other_errors_are_not():
    unknown = "OSError: libstrange.so.3: cannot open shared object file"
    assert "apt-file search libstrange.so.3" in cure_of(unknown)
    assert cure_of("ValueError: numpy.dtype size changed") == ""
    broken = look_at_library("numpy", fake("ValueError: numpy.dtype size changed"))
    assert "--force-reinstall numpy" in broken.cure
    crashed = look_at_library("numpy", fake("", returncode=-4))
    assert "exit code -4" in crashed.found


def test_what_is_not_installed_says_how_and_what_hangs_is_given_up():
    absent = look_at_library("no-such-distribution")
    assert (absent.state, absent.found) == ("bad", "not installed")
    assert absent.cure == f"{sys.executable} -m pip install no-such-distribution"

    def hangs(*arguments, **options):
        raise subprocess.TimeoutExpired("python", options["timeout"])

    assert "does not load within" in look_at_library("numpy", hangs).found


def test_a_library_that_is_there_is_really_imported():
    finding = look_at_library("tomli-w")
    assert finding.state == "good"
    assert finding.found[0].isdigit()


def quick(monkeypatch, *findings):
    monkeypatch.setattr(doctor, "libraries", lambda extra="": () if extra else ("a",))
    monkeypatch.setattr(doctor, "look_at_library", lambda name: findings[0])


def test_a_sound_installation_ends_with_0_and_a_lacking_one_with_1(monkeypatch, tmp_path, capsys):
    quick(monkeypatch, Finding(name="a", state="good", found="1.0"))
    assert main(["doctor", "--path", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "MISSING" not in text
    assert "GB free in" in text
    quick(
        monkeypatch,
        Finding(name="a", state="bad", found="1.0", cure="sudo apt-get install libgl1"),
    )
    assert main(["doctor", "--path", str(tmp_path)]) == 1
    said = capsys.readouterr()
    assert "MISSING a" in said.out
    assert "-> sudo apt-get install libgl1" in said.out
    assert said.err.strip().endswith("all system packages: apt-get install libgl1")
    assert main(["doctor", "--path", str(tmp_path), "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["content"] is False
    assert {"name", "state", "found", "cure"} == set(data["findings"][0])


def test_a_full_disk_and_a_small_memory_are_told_and_stop_nobody(monkeypatch, tmp_path):
    usage = SimpleNamespace(free=10**8)
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda path: usage)
    monkeypatch.setattr(doctor, "memory_gb", lambda: 1.5)
    quick(monkeypatch, Finding(name="a", state="good", found="1.0"))
    found = doctor.examine(tmp_path)
    weak = {f.name: f for f in found.findings if f.state == "weak"}
    assert weak.keys() == {"disk", "memory"}
    assert "--quality low" in weak["memory"].cure
    assert found.is_content
    assert any(line.startswith("weak") for line in lines_of(found.findings))


def test_a_folder_that_is_not_there_is_said(tmp_path, capsys, monkeypatch):
    quick(monkeypatch, Finding(name="a", state="good", found="1.0"))
    assert main(["doctor", "--path", str(tmp_path / "no")]) == 1
    assert "is no folder" in capsys.readouterr().err


def test_the_memory_is_that_of_the_machine_or_less():
    assert memory_gb() is None or 0.1 < memory_gb() < 1e5


@pytest.mark.parametrize(
    "error",
    [
        OSError("libGL.so.1: cannot open shared object file: No such file or directory"),
        ImportError("libgomp.so.1: cannot open shared object file: No such file or directory"),
        ModuleNotFoundError("No module named 'pycolmap'"),
    ],
)
def test_a_library_that_does_not_load_ends_any_command_with_one_sentence(
    error, monkeypatch, capsys
):
    def fails(*arguments, **options):
        raise error

    monkeypatch.setattr("semsfm_colmap.pipeline.evaluate.evaluate_project", fails)
    assert main(["evaluate", "project", "truth"]) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "does not load" in said
    assert "semsfm doctor" in said
