"""`python -m semsfm_colmap.example`: the same as the command `semsfm example`."""

from __future__ import annotations

import sys

from semsfm_colmap.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["example", *sys.argv[1:]]))
