"""Which hand? The decision of depth reversal.

(R, X) and (D R D, D X), D = diag(1, 1, -1), have identical orthographic images, so no residual
tells them apart. Other evidence does: each kind is a `Cue`, odd under reversal; `decide_depth_sign`
adds their log odds. docs/depth_reversal.md holds the measurements behind the numbers.

visibility    what is seen hides what lies behind it, and bodies are seen on their near side
known_tilt    the direction of a known tilt
decision      all evidence together, and the user's word
"""

from semsfm_colmap.refinement.depth_reversal.cue import Cue
from semsfm_colmap.refinement.depth_reversal.decision import (
    DepthSignWord,
    apply_user_word,
    decide_depth_sign,
    reverse_depth,
)
from semsfm_colmap.refinement.depth_reversal.known_tilt import (
    axis_from_receding_edge,
    known_tilt_cue,
)
from semsfm_colmap.refinement.depth_reversal.visibility import (
    CUES,
    SHAPE_CUES,
    visibility_cues,
)

__all__ = [
    "CUES",
    "SHAPE_CUES",
    "Cue",
    "DepthSignWord",
    "apply_user_word",
    "axis_from_receding_edge",
    "decide_depth_sign",
    "known_tilt_cue",
    "reverse_depth",
    "visibility_cues",
]
