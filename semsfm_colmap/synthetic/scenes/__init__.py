"""Specimens: each module builds one, in scene units, the axis of rotation through the origin."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.synthetic.options import SceneName
from semsfm_colmap.synthetic.scenes.base import Specimen, View


def build_specimen(scene: SceneName, view: View, rng: np.random.Generator) -> Specimen:
    """The specimen of a scene, as fine and as large as the view asks for."""
    from semsfm_colmap.synthetic.scenes import clump, field, grain, shapes

    builders = {
        "grain": grain.build,
        "field": field.build,
        "clump": clump.build,
        "cap": shapes.build_cap,
        "step": shapes.build_step,
        "pyramid": shapes.build_pyramid,
        "cylinder": shapes.build_cylinder,
    }
    return builders[scene](view, rng)
