"""Libraries that are installed on request: `pip install "semsfm-colmap[mesh]"`, `[cluster]`.

Each is imported here, so that one that is missing is said in one sentence.
"""

from __future__ import annotations

import importlib
from typing import Any, Literal

from semsfm_colmap.errors import MissingDependencyError

Extra = Literal["mesh", "cluster"]
"""As pyproject.toml calls them."""
EXTRAS: dict[Extra, str] = {"mesh": "open3d", "cluster": "distributed"}
"""Without this library an extra is not there."""
PURPOSES: dict[Extra, str] = {
    "mesh": "meshes, texture, rendered series and 3MF files",
    "cluster": "--executor dask",
}
"""What each is for, as a person is told."""


def import_extra(module: str, extra: Extra) -> Any:
    """A module of an extra.

    Raises
    ------
    MissingDependencyError
        It is not installed; the message says what to type.

    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        library = module.split(".")[0]
        if error.name != library:
            raise
        raise MissingDependencyError(
            f"this needs {library}, which is not installed: run "
            f'`pip install "semsfm-colmap[{extra}]"`'
        ) from error
