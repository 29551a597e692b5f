"""three.js, which draws the scene: as trimesh ships it within its own viewer (both MIT).

`trimesh.viewer.notebook.scene_to_html` gives a page with the library in it, whose licence line goes
along. trimesh reads and writes our meshes anyway: no other package is needed for it.
"""

from __future__ import annotations

import re
from functools import cache

from semsfm_colmap.errors import MissingDependencyError

LIBRARY = re.compile(r"/\*\*\s*\n \* @license\s*\n[^/]*Three\.js Authors.*?\}\)\);(?=\s*\n)", re.S)
"""From the licence to the end of the module that sets ``THREE``, which is one line."""


@cache
def three_js() -> str:
    """The script that defines ``THREE``.

    Raises
    ------
    MissingDependencyError
        The installed trimesh has no three.js where the others have it.

    """
    import trimesh
    from trimesh.viewer.notebook import scene_to_html

    triangle = trimesh.Trimesh(vertices=[[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces=[[0, 1, 2]])
    found = LIBRARY.search(scene_to_html(trimesh.Scene(triangle)))
    if found is None or "OrthographicCamera" not in found[0]:
        raise MissingDependencyError(
            f"trimesh {trimesh.__version__} does not bring three.js along as the releases from "
            "4.10 on did: install one of those for the 3-D viewer"
        )
    return found[0].replace("</script", "<\\/script")
