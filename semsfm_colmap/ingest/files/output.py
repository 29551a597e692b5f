"""Write the outputs of the stage: each file whole or not at all."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from semsfm_colmap.errors import UsageError


def write_atomic(path: Path, content: bytes) -> None:
    """Write aside and rename, so that an interrupted run leaves no half file."""
    aside = path.with_name(f".{path.name[:200]}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        aside.write_bytes(content)
        os.replace(aside, path)
    except OSError as error:
        with suppress(OSError):
            aside.unlink(missing_ok=True)
        raise UsageError(
            f"{path} cannot be written ({error.strerror}); check the output folder."
        ) from error
    except BaseException:
        aside.unlink(missing_ok=True)
        raise
