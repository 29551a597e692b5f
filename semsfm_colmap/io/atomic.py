"""Small files written whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any


def write_json(data: Any, path: Path) -> None:
    """Write aside, then rename; numpy numbers become plain ones."""
    aside = path.with_name(f".{path.name}.part")
    aside.write_text(json.dumps(data, indent=1, default=float) + "\n", encoding="utf-8")
    os.replace(aside, path)
