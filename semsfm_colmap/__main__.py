"""`python -m semsfm_colmap`: the same as the command `semsfm`."""

from __future__ import annotations

import sys

from semsfm_colmap.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
