import pytest
from trimesh.viewer import notebook

from semsfm_colmap.errors import MissingDependencyError
from semsfm_colmap.report.viewer.library import three_js


def test_the_library_comes_whole_with_its_licence_and_nothing_else():
    code = three_js()
    assert code.startswith("/**\n * @license")
    assert "SPDX-License-Identifier: MIT" in code[:200]
    assert code.endswith("}));")
    for name in ("OrthographicCamera", "Raycaster", "clippingPlanes", "MeshLambertMaterial"):
        assert name in code
    assert "$B64GLTF" not in code
    assert "TrackballControls" not in code
    assert "</script" not in code


def test_a_trimesh_without_it_is_told(monkeypatch):
    monkeypatch.setattr(notebook, "scene_to_html", lambda scene: "<html></html>")
    three_js.cache_clear()
    try:
        with pytest.raises(MissingDependencyError, match=r"three\.js"):
            three_js()
    finally:
        three_js.cache_clear()
