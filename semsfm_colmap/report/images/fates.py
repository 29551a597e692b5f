"""Which keypoint was dropped by which stage.

A keypoint goes through matching, verification, the building of tracks and the filters of the
mapping; its fate is the first of them that dropped it. A guided pass measures every point again and
gives its observations keypoints of their own, behind the measured ones. A measured keypoint of a
track then counts as kept where the model has such an observation within `SAME_PLACE_PX`; guided
observations where no kept keypoint lies are found ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from semsfm_colmap.report.images.evidence import ImageEvidence, PairEvidence
from semsfm_colmap.types import Bool, Float, Int

SAME_PLACE_PX = 2.0
"""The guided pass moves a point by less: it aligns to a fraction of a pixel, and the scan drift and
drag that are taken out of its observations are below 1 px."""


class Fate(IntEnum):
    """What became of a keypoint, in the order of the stages."""

    UNMATCHED = 0
    UNVERIFIED = 1
    NO_TRACK = 2
    REJECTED = 3
    KEPT = 4
    GUIDED = 5


FATE_LABELS = {
    Fate.UNMATCHED: "never matched",
    Fate.UNVERIFIED: "matched, in no verified pair",
    Fate.NO_TRACK: "verified, in no track",
    Fate.REJECTED: "in a track, rejected by filtering",
    Fate.KEPT: "kept",
    Fate.GUIDED: "found by the guided pass",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Keypoints:
    """The keypoints of an image with their fates, found ones behind the measured."""

    xy: Float
    """(K, 2) px"""
    shape: Float
    """(K, 2, 2) maps the unit circle to the region, px; zero for those of the guided pass"""
    fate: Int
    """(K,)"""

    def counts(self) -> dict[Fate, int]:
        """How many have each fate."""
        number = np.bincount(self.fate, minlength=len(Fate))
        return {fate: int(number[fate]) for fate in Fate}


def matched_keypoints(name: str, pairs: Sequence[PairEvidence], num: int) -> tuple[Bool, Bool]:
    """(K,) twice: in a match of any pair, and in a verified one."""
    matched, verified = np.zeros(num, dtype=bool), np.zeros(num, dtype=bool)
    for pair in pairs:
        for side in (0, 1):
            if pair.names[side] == name:
                matched[pair.matches[:, side]] = True
                verified[pair.matches[pair.verified, side]] = True
    return matched, verified


def keypoint_fates(
    name: str,
    image: ImageEvidence,
    pairs: Sequence[PairEvidence],
    observed_idx: Int,
    observed_xy: Float,
) -> Keypoints:
    """The fates of an image's keypoints.

    Parameters
    ----------
    pairs : those of this image, at least
    observed_idx, observed_xy : (P,), (P, 2) keypoint numbers and places, px, of the observations
        that the model has of this image; none for an image that is not registered

    """
    from scipy.spatial import cKDTree

    num = len(image.keypoints)
    xy = np.asarray(image.keypoints[:, :2], dtype=np.float64)
    matched, verified = matched_keypoints(name, pairs, num)
    kept = np.zeros(num, dtype=bool)
    measured = observed_idx < num
    kept[observed_idx[measured]] = True
    guided_xy = observed_xy[~measured]
    lonely = np.ones(len(guided_xy), dtype=bool)
    tracked = np.flatnonzero(image.in_track)
    if len(guided_xy) and len(tracked):
        away, nearest = cKDTree(guided_xy).query(xy[tracked])
        same = np.asarray(away <= SAME_PLACE_PX)
        kept[tracked[same]] = True
        lonely[np.asarray(nearest)[same]] = False
    fate = np.full(num, Fate.UNMATCHED, dtype=np.int64)
    fate[matched] = Fate.UNVERIFIED
    fate[verified] = Fate.NO_TRACK
    fate[image.in_track] = Fate.REJECTED
    fate[kept] = Fate.KEPT
    found = guided_xy[lonely]
    return Keypoints(
        xy=np.concatenate([xy, found]),
        shape=np.concatenate([region_shapes(image.keypoints), np.zeros((len(found), 2, 2))]),
        fate=np.concatenate([fate, np.full(len(found), Fate.GUIDED)]),
    )


def region_shapes(keypoints: Float) -> Float:
    """(K, 2, 2) matrices that map the unit circle to the regions.

    COLMAP's rows hold nothing more than the place, scale and angle, or the matrix itself.
    """
    num, columns = keypoints.shape
    if columns >= 6:
        return np.asarray(keypoints[:, 2:6], dtype=np.float64).reshape(num, 2, 2)
    if columns >= 4:
        scale, angle = np.asarray(keypoints[:, 2:4], dtype=np.float64).T
        c, s = scale * np.cos(angle), scale * np.sin(angle)
        return np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    return np.zeros((num, 2, 2))
