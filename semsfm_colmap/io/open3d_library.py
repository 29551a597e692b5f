"""The one place that imports open3d, so that a missing system library is said in one sentence."""

from __future__ import annotations

from typing import Any

from semsfm_colmap.errors import MissingDependencyError
from semsfm_colmap.io.extras import import_extra
from semsfm_colmap.io.interrupt import signals_held

DEBIAN_PACKAGES = "libusb-1.0-0 libegl1 libgl1 libx11-6 libudev1 libidn2-0 libgomp1"
"""What the open3d wheel links against and a bare Debian image may lack."""


def import_open3d() -> Any:
    """The module open3d.

    Raises
    ------
    MissingDependencyError
        When the package, or a system library that its wheel links against, is missing.

    """
    try:
        with signals_held():  # it takes Ctrl-C for a failure of its own
            return import_extra("open3d", "mesh")
    except ModuleNotFoundError:
        raise  # another one, which the system has no package for
    except (ImportError, OSError) as error:
        reason = str(error).splitlines()[0].rstrip(".") if str(error) else type(error).__name__
        raise MissingDependencyError(
            f"open3d is installed but does not load ({reason}): on Debian or Ubuntu run "
            f"`apt-get install {DEBIAN_PACKAGES}`."
        ) from error
