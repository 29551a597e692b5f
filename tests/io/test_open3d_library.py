"""A missing library is said in one sentence."""

from __future__ import annotations

import importlib
from typing import Any

import pytest

from semsfm_colmap.errors import MissingDependencyError
from semsfm_colmap.io.open3d_library import import_open3d


def failing(error: Exception) -> Any:
    def load(_: str) -> None:
        raise error

    return load


def test_open3d_is_there() -> None:
    assert hasattr(import_open3d(), "geometry")


@pytest.mark.parametrize("kind", [ImportError, OSError])
def test_a_missing_system_library_names_the_packages(
    monkeypatch: pytest.MonkeyPatch, kind: type[Exception]
) -> None:
    reason = "libusb-1.0.so.0: cannot open shared object file: No such file or directory"
    monkeypatch.setattr(importlib, "import_module", failing(kind(reason)))
    with pytest.raises(MissingDependencyError) as caught:
        import_open3d()
    message = str(caught.value)
    assert "libusb-1.0.so.0" in message
    assert "apt-get install libusb-1.0-0 libegl1 libgl1" in message
    assert "\n" not in message


def test_open3d_not_installed_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    error = ModuleNotFoundError("No module named 'open3d'", name="open3d")
    monkeypatch.setattr(importlib, "import_module", failing(error))
    with pytest.raises(MissingDependencyError, match=r'pip install "semsfm-colmap\[mesh\]"'):
        import_open3d()


def test_another_missing_module_is_not_blamed_on_open3d(monkeypatch: pytest.MonkeyPatch) -> None:
    error = ModuleNotFoundError("No module named 'dash'", name="dash")
    monkeypatch.setattr(importlib, "import_module", failing(error))
    with pytest.raises(ModuleNotFoundError, match="dash"):
        import_open3d()
