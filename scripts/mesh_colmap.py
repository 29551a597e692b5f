"""A mesh of any COLMAP folder: what `semsfm mesh --colmap_path FOLDER` does, as a script.

usage: mesh_colmap.py FOLDER [--sparse_path MODEL] [--image_path IMAGES] [--output_path OUTPUT]
                      [--surface.method poisson ...]
"""

from __future__ import annotations

import sys

from semsfm_colmap.cli.main import main

if __name__ == "__main__":
    folder, rest = sys.argv[1:2], sys.argv[2:]
    if not folder or folder[0].startswith("-"):
        sys.exit(main(["mesh", "--colmap_path", "--help"]) if folder else __doc__)
    sys.exit(main(["mesh", "--colmap_path", *folder, *rest]))
