"""All evidence together: one verdict, its confidence, and the user's word above it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.geometry.rotations import depth_reversed
from semsfm_colmap.refinement.depth_reversal.cue import (
    CONVEX_CUES,
    CONVEX_MAX_LOGIT,
    MAX_LOGIT,
    Cue,
)
from semsfm_colmap.types import MOST_TOLD_CONFIDENCE, DepthSign, Float, OrthographicCameras

DepthSignWord = Literal["auto", "as_is", "reversed"]
"""auto: the evidence decides, and both models are written where it does not; as_is: the user has
looked and the model that auto puts first is right; reversed: it is the other one."""


def reverse_depth(cameras: OrthographicCameras, points: Float) -> tuple[OrthographicCameras, Float]:
    """The twin with the same images: ``R -> D R D``, ``X -> D X``."""
    twin = replace(cameras, cam_from_world=depth_reversed(np.asarray(cameras.cam_from_world)))
    return twin, points * np.array([1.0, 1.0, -1.0])


def told(probability: float) -> str:
    """As finely as it is calibrated: two digits, and no certainty (docs/depth_reversal.md)."""
    if probability > MOST_TOLD_CONFIDENCE:
        return f"above {MOST_TOLD_CONFIDENCE}"
    if probability < 1.0 - MOST_TOLD_CONFIDENCE:
        return f"below {1.0 - MOST_TOLD_CONFIDENCE:.2f}"
    return f"{probability:.2f}"


def fused_logit(logits: Mapping[str, float]) -> float:
    """Log odds of the hand at hand from those of the cues.

    They are added: their factors were fitted jointly, so that what the cues have in common is
    counted once; where they contradict each other they cancel. Those that take the body to be
    convex are wrong together, and bounded together.
    """
    convex = sum(x for name, x in logits.items() if name in CONVEX_CUES)
    others = sum(x for name, x in logits.items() if name not in CONVEX_CUES)
    bounded = np.clip(convex, -CONVEX_MAX_LOGIT, CONVEX_MAX_LOGIT)
    return float(np.clip(bounded + others, -MAX_LOGIT, MAX_LOGIT))


def decide_depth_sign(cues: Mapping[str, Cue], min_confidence: float) -> tuple[DepthSign, bool]:
    """Fuse the cues into a verdict; True when the model at hand must be reversed.

    Parameters
    ----------
    cues : by name, for the model at hand
    min_confidence : below it the hand counts as ambiguous

    """
    total = fused_logit({name: cue.logit for name, cue in cues.items()})
    reverse = total < 0.0
    confidence = float(1.0 / (1.0 + np.exp(-abs(total))))
    evidence = {
        name: (1.0 - c.probability if reverse else c.probability) for name, c in cues.items()
    }
    resolved = confidence >= min_confidence
    detail = ", ".join(f"{name} {told(p)}" for name, p in evidence.items()) or "no evidence"
    known = "known tilt" in cues and cues["known tilt"].probability != 0.5
    what = "visibility and the known tilt" if known else "visibility"
    if resolved:
        message = f"the hand is decided by {what} with confidence {told(confidence)} ({detail})"
    else:
        message = (
            f"{what} does not decide the hand (confidence {told(confidence)}: {detail}); both "
            "models are written; "
            + ("your word" if known else "a known direction of the tilt, or your word,")
            + " would settle it"
        )
    return (
        DepthSign(
            status="resolved" if resolved else "ambiguous",
            confidence=confidence,
            evidence=evidence,
            message=message,
        ),
        reverse,
    )


def apply_user_word(sign: DepthSign, reverse: bool, word: DepthSignWord) -> tuple[DepthSign, bool]:
    """The user's word stands above the evidence, which is kept beside it.

    The word refers to what auto writes first, the model a person has looked at: "reversed" turns
    the verdict of `decide_depth_sign` round. The solver's own hand is chance and means nothing.
    """
    if word == "auto":
        return sign, reverse
    if word not in ("as_is", "reversed"):
        raise UsageError(f"depth_sign = {word!r} but expected auto, as_is or reversed.")
    turned = word == "reversed"
    evidence = {name: 1.0 - p if turned else p for name, p in sign.evidence.items()}
    message = "the hand was given by the user"
    if turned and sign.status == "resolved":
        message += f", against evidence of confidence {told(sign.confidence)} for the other one"
    return (
        DepthSign(
            status="resolved",
            confidence=1.0,
            evidence={**evidence, "user": 1.0},
            message=message,
        ),
        reverse != turned,
    )
