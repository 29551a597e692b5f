"""The guided second pass between the first and the last adjustment of a part."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from semsfm_colmap.geometry.alignment import align_rotations
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.geometry.subset import keep_tracks
from semsfm_colmap.io.grey import read_grey, read_mask
from semsfm_colmap.mapping.drift import adjust_last
from semsfm_colmap.matching.guided.grow import Grown, grow_tracks
from semsfm_colmap.matching.guided.options import GuidedOptions
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import Refined, refine
from semsfm_colmap.types import Array, Bool, Float, Int, Observations

if TYPE_CHECKING:
    from semsfm_colmap.mapping.finish import MappedPart

IMAGES_IN_MEMORY = 64
SETTLED_GROWTH = 1.2
"""A pass that multiplies the observations by more calls for another."""
MIN_KEPT_SHARE = 0.9
"""A pass that leaves fewer observations than this share is not an improvement."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Guide:
    """What the second pass needs besides a first model."""

    read_image: Callable[[int], Array]
    """number in the series -> pixels (H, W)"""
    read_mask: Callable[[int], Bool | None]
    read_keypoints: Callable[[int], Float]
    """number in the series -> all measured keypoints (K, 2) px"""
    options: GuidedOptions


def guide_from_folders(
    image_path: Path,
    mask_path: Path | None,
    keypoints: Mapping[str, Float],
    options: GuidedOptions,
) -> Guide:
    """Read prepared images, and masks of COLMAP's convention, when they are needed.

    Parameters
    ----------
    keypoints : (K, 2) px of each image, in the order of the series

    """
    names = list(keypoints)

    @lru_cache(maxsize=IMAGES_IN_MEMORY)
    def read_image(i: int) -> Array:
        return read_grey(image_path / names[i])

    return Guide(
        read_image=read_image,
        read_mask=lambda i: read_mask(mask_path, names[i]),
        read_keypoints=lambda i: keypoints[names[i]],
        options=options,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Guided:
    """A part after its second pass."""

    refined: Refined
    observations: Observations
    """of the whole series' images; `keypoint_idx` counts from 0 within each image"""
    displacement: Displacement
    """what was taken out of the observations"""
    figures: dict[str, Any]


def refine_guided(
    first: Refined,
    observations: Observations,
    guide: Guide,
    refinement: RefinementOptions,
    height_px: Float,
    *,
    rng: np.random.Generator,
    seed: int,
    say: Callable[[str], None],
) -> Guided | None:
    """Align the known observations, then look for every point everywhere; adjust after each.

    Parameters
    ----------
    height_px : heights of all images of the series

    Returns
    -------
    None when the pass finds less than there was: blurred images, too few points

    """
    value: Refined = first
    grown: Grown | None = None
    seeds = observations
    for k in range(guide.options.rounds):
        step = _grow(value, seeds, guide, extend=k > 0, seed=seed)
        if step is None:
            return None
        adjusted = refine(
            value.cameras, value.images, step.observations, refinement, rng=rng, seed=seed
        )
        if adjusted.value is None or len(adjusted.value.images) < len(first.images):
            return None
        turned = camera_turn(value, adjusted.value)
        growth = len(adjusted.value.observations) / max(len(value.observations), 1)
        value, grown = adjusted.value, step
        say(
            f"guided pass {k + 1}: structure finer than {step.high_pass_px:g} px, "
            f"{len(step.observations)} of {step.num_predicted} places found, "
            f"{len(value.tracks)} points, {len(value.observations)} observations, "
            f"sigma {value.sigma_px:.3f} px, cameras turned by {np.rad2deg(turned):.3f} deg"
        )
        if k > 0:
            seeds = step.observations
            if turned < np.deg2rad(guide.options.converged_deg) and growth < SETTLED_GROWTH:
                break
    if grown is None or len(value.observations) < MIN_KEPT_SHARE * len(first.observations):
        return None
    end = adjust_last(
        grown,
        value,
        refinement,
        height_px,
        own_weights=guide.options.own_weights,
        rng=rng,
        seed=seed,
    )
    if end is None:
        return None
    last = end.refined
    return Guided(
        refined=last,
        observations=end.observations,
        displacement=end.displacement,
        figures={
            "num_passes": k + 1,
            "high_pass_px": grown.high_pass_px,
            "num_places": grown.num_predicted,
            "num_found": len(grown.observations),
            "num_observations_before": len(first.observations),
            "num_observations": len(last.observations),
            "mean_track_length_before": len(first.observations) / max(len(first.tracks), 1),
            "mean_track_length": len(last.observations) / max(len(last.tracks), 1),
            "sigma_before_px": first.sigma_px,
            "sigma_px": last.sigma_px,
            "largest_drift_px": float(np.abs(end.displacement.drift_px).max(initial=0.0)),
        },
    )


def camera_turn(before: Refined, after: Refined) -> float:
    """Root mean square angle by which an adjustment turned the cameras, rad, but for a common one.

    Infinite where it registered other images.
    """
    if not np.array_equal(before.images, after.images):
        return float("inf")
    old, new = before.cameras.cam_from_world, after.cameras.cam_from_world
    back = np.swapaxes(old, 1, 2)
    turn = rotation_angle(new @ align_rotations(new, old) @ back)
    return float(np.sqrt(np.mean(turn**2)))


def _grow(
    value: Refined, observations: Observations, guide: Guide, *, extend: bool, seed: int
) -> Grown | None:
    """`grow_tracks` on the registered images, numbered as the series."""
    number = np.full(observations.num_images, -1, dtype=np.int64)
    number[value.images] = np.arange(len(value.images))
    local, _ = keep_tracks(
        observations, np.ones(len(observations), bool), min_length=2, image_number=number
    )
    grown = grow_tracks(
        value.cameras,
        local,
        lambda i: guide.read_image(int(value.images[i])),
        guide.options,
        extend=extend,
        read_mask=lambda i: guide.read_mask(int(value.images[i])),
        read_keypoints=lambda i: guide.read_keypoints(int(value.images[i])),
        seed=seed,
    )
    if grown is None:
        return None
    obs = grown.observations
    return replace(
        grown,
        observations=replace(
            obs, image_idx=value.images[obs.image_idx], num_images=observations.num_images
        ),
    )


def append_keypoints(
    parts: Sequence[MappedPart], keypoints: Mapping[str, Float]
) -> tuple[list[MappedPart], dict[str, Float]]:
    """Give the observations of guided parts keypoints of their own, after the measured ones.

    Returns
    -------
    The parts with renumbered `keypoint_idx`, and (K', 2) px of each image

    """
    extended = dict(keypoints)
    result = []
    for part in parts:
        if not part.guided:
            result.append(part)
            continue
        obs = part.reconstruction.observations
        numbers: Int = np.empty(len(obs), dtype=np.int64)
        for i, name in enumerate(part.reconstruction.image_names):
            rows = np.flatnonzero(obs.image_idx == i)
            numbers[rows] = len(extended[name]) + np.arange(len(rows))
            extended[name] = np.concatenate([extended[name], obs.xy[rows]])
        observations = replace(obs, keypoint_idx=numbers)
        twin = part.twin
        result.append(
            replace(
                part,
                reconstruction=replace(part.reconstruction, observations=observations),
                twin=None if twin is None else replace(twin, observations=observations),
            )
        )
    return result, extended


def guided_matches(parts: Sequence[MappedPart], min_num_matches: int) -> dict[tuple[str, str], Int]:
    """Inlier matches (L, 2) of keypoints between all pairs of images that share enough points."""
    from scipy import sparse

    matches: dict[tuple[str, str], Int] = {}
    for part in parts:
        if not part.guided:
            continue
        r = part.reconstruction
        obs = r.observations.select(r.inlier)
        seen = sparse.csr_array(
            (np.ones(len(obs), dtype=np.int32), (obs.image_idx, obs.track_idx)),
            shape=(obs.num_images, obs.num_tracks),
        )
        shared = sparse.triu(seen @ seen.T, k=1).tocoo()
        rows = [np.flatnonzero(obs.image_idx == i) for i in range(obs.num_images)]
        enough = shared.data >= min_num_matches
        for i, j in zip(shared.row[enough], shared.col[enough], strict=True):
            _, a, b = np.intersect1d(
                obs.track_idx[rows[i]],
                obs.track_idx[rows[j]],
                assume_unique=True,
                return_indices=True,
            )
            matches[r.image_names[i], r.image_names[j]] = np.column_stack(
                [obs.keypoint_idx[rows[i][a]], obs.keypoint_idx[rows[j][b]]]
            )
    return matches
