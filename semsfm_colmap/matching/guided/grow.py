"""Tracks grown by looking for every point in every image that should see it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.normals import estimate_normals
from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.geometry.subset import keep_tracks
from semsfm_colmap.geometry.triangulation import triangulate_tracks, triangulation_angle
from semsfm_colmap.matching.guided.align import (
    Templates,
    align_patches,
    prepare_templates,
    read_patches,
)
from semsfm_colmap.matching.guided.candidates import add_candidates
from semsfm_colmap.matching.guided.distinct import distinct_points, distinct_tracks
from semsfm_colmap.matching.guided.filtering import FilteredImages
from semsfm_colmap.matching.guided.options import GuidedOptions
from semsfm_colmap.matching.guided.predict import (
    Predictions,
    References,
    Seeds,
    frontal_references,
    predict,
)
from semsfm_colmap.types import (
    Array,
    Bool,
    Float,
    Int,
    Observations,
    OrthographicCameras,
    ParallelMap,
)

HIGH_PASS_PX = (2.0, 3.0, 4.5, 7.0, 10.0, 15.0)
"""Tried from the finest on."""
MIN_FOUND_SHARE = 0.6
"""The finest high-pass is taken at which so many known observations are found again."""
NUM_TRIAL_OBSERVATIONS = 3000
NUM_NEIGHBORS = 30
"""Points that a normal is fitted to."""
SEED_THRESHOLD_PX = 2.0
"""Reprojection error of the observations that a point is triangulated from."""
MIN_SEED_ANGLE_DEG = 1.0
SAME_SPOT = 0.5
"""Before they are looked for everywhere, points nearer than this share of `min_separation_px` show
the same spot: what is left of them is told apart by its places afterwards."""
MIN_POINTS = 50
"""Fewer points do not give normals."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Grown:
    """What a pass has found."""

    observations: Observations
    """sorted by track, then image; `keypoint_idx` counts from 0 within each image"""
    sigma_px: Float
    """(O,) standard deviation of each alignment, up to a factor"""
    baseline_sine: Float
    """(O,) sine of the angle between the view and the reference view"""
    num_predicted: int
    """how many places were looked at"""
    high_pass_px: float


def find_seeds(
    cameras: OrthographicCameras, observations: Observations, seed: int
) -> tuple[Seeds, Observations] | None:
    """Triangulate tracks, also those of two views, and give them normals and a reference view.

    Returns
    -------
    The seeds and the observations that support them, or None with too few of them

    """
    obs = observations
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    X, inlier = triangulate_tracks(
        cameras.projection,
        np.asarray(cameras.translation_px),
        obs.image_idx,
        pointer,
        obs.xy,
        threshold_px=SEED_THRESHOLD_PX,
        trials=15,
        seed=seed,
    )
    angle = triangulation_angle(cameras.viewing_direction, obs.image_idx, pointer, inlier)
    good = np.isfinite(X[:, 0]) & (angle > np.deg2rad(MIN_SEED_ANGLE_DEG))
    kept, tracks = keep_tracks(obs, inlier & good[obs.track_idx], min_length=2)
    if len(tracks) < MIN_POINTS:
        return None
    points = X[tracks]
    direction = cameras.viewing_direction[kept.image_idx]
    mean = np.stack(
        [np.bincount(kept.track_idx, direction[:, k], minlength=len(tracks)) for k in range(3)],
        axis=1,
    )
    normals = estimate_normals(
        points, mean / np.linalg.norm(mean, axis=1, keepdims=True), NUM_NEIGHBORS
    )
    return Seeds(
        points=points, normals=normals, references=frontal_references(cameras, normals, kept)
    ), kept


def reference_templates(
    references: References,
    read_filtered: Callable[[int, float], Array],
    high_pass_px: float,
    options: GuidedOptions,
) -> Templates:
    """The patches of all points in their reference views, ready for alignment."""
    radius = options.patch_radius_px
    n = 2 * radius + 1
    patches = np.full((len(references.image_idx), n, n), np.nan, dtype=np.float32)
    for i in np.unique(references.image_idx[references.image_idx >= 0]):
        mine = np.flatnonzero(references.image_idx == i)
        image = read_filtered(int(i), high_pass_px)
        patches[mine] = read_patches(image, references.xy[mine], radius)
    return prepare_templates(patches, options.window_sigma_px)


def choose_high_pass(
    cameras: OrthographicCameras,
    seeds: Seeds,
    observations: Observations,
    read_image: Callable[[int], Array],
    read_filtered: Callable[[int, float], Array],
    options: GuidedOptions,
    rng: np.random.Generator,
) -> float:
    """The finest high-pass at which most of the known observations are found again.

    Finer structure moves less with the shading; in a blurred or noisy image it is not there.
    """
    if options.high_pass_px > 0.0:
        return options.high_pass_px
    images = np.unique(observations.image_idx)
    some = np.unique(images[np.linspace(0, len(images) - 1, 5).astype(int)])
    rows = np.flatnonzero(np.isin(observations.image_idx, some))
    rows = rng.permutation(rows)[:NUM_TRIAL_OBSERVATIONS]
    known = np.zeros(len(observations), dtype=bool)
    known[rows] = True
    tracks = np.unique(observations.track_idx[rows])
    image_idx = np.full_like(seeds.references.image_idx, -1)
    image_idx[tracks] = seeds.references.image_idx[tracks]
    references = replace(seeds.references, image_idx=image_idx)
    share = []
    for high_pass in HIGH_PASS_PX:
        templates = reference_templates(references, read_filtered, high_pass, options)
        found = tried = 0
        for i in some:
            mine = observations.track_idx[known & (observations.image_idx == i)]
            image = read_image(int(i))
            where = predict(
                int(i), cameras, seeds.points, seeds.normals, references, image.shape[::-1], options
            )
            these = np.isin(where.track_idx, mine)
            alignment = align_patches(
                templates,
                where.track_idx[these],
                read_filtered(int(i), high_pass),
                where.xy[these],
                where.warp[these],
                max_shift_px=options.max_shift_px,
                min_correlation=options.min_correlation,
            )
            found += int(alignment.found.sum())
            tried += int(these.sum())
        share.append(found / max(tried, 1))
        if share[-1] >= MIN_FOUND_SHARE:
            return high_pass
    return HIGH_PASS_PX[int(np.argmax(share))]


def one_a_spot(
    cameras: OrthographicCameras, seeds: Seeds, known: Observations, options: GuidedOptions
) -> Seeds:
    """The seeds with a reference view for one track only of those that show the same spot."""
    radius = SAME_SPOT * options.min_separation_px / float(np.median(cameras.scale_px_per_unit))
    length = np.bincount(known.track_idx, minlength=len(seeds.points))
    keep = distinct_points(seeds.points, length, radius)
    image_idx = np.where(keep, seeds.references.image_idx, -1)
    return replace(seeds, references=replace(seeds.references, image_idx=image_idx))


def grow_tracks(
    cameras: OrthographicCameras,
    observations: Observations,
    read_image: Callable[[int], Array],
    options: GuidedOptions,
    *,
    extend: bool = True,
    read_mask: Callable[[int], Bool | None] = lambda i: None,
    read_keypoints: Callable[[int], Float] | None = None,
    read_filtered: Callable[[int, float], Array] | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
    parallel_map: ParallelMap = map,
) -> Grown | None:
    """Look for the point of every track in every image that should see it.

    Parameters
    ----------
    cameras : of the images that `observations` number
    observations : sorted by track, from two views on
    read_image : number -> pixels (H, W)
    extend : False aligns the known observations only, from where they were measured: what a model
        that is still biased should do first, for its predictions are
    read_mask : number -> True where the specimen is, or None
    read_keypoints : number -> (K, 2) px; those without a track are tried as points when extending
    read_filtered : number and high-pass in px -> band-passed pixels (H, W), for several passes to
        share what they have filtered
    parallel_map : over the images; the alignment in one of them has threads of its own

    Returns
    -------
    Grown, or None when too few points are known to start from

    """
    start = find_seeds(cameras, observations, seed)
    if start is None:
        return None
    seeds, known = start
    read_filtered = read_filtered or FilteredImages(read_image)
    rng = np.random.default_rng(seed)
    high_pass = choose_high_pass(cameras, seeds, known, read_image, read_filtered, options, rng)
    if extend:
        seeds = one_a_spot(cameras, seeds, known, options)
    if extend and read_keypoints is not None:
        seeds = add_candidates(
            cameras,
            seeds,
            known,
            read_keypoints,
            max_shift_px=options.max_shift_px,
            max_num_points=options.fill_up_to,
            rng=rng,
        )
    search = _Search(
        cameras,
        seeds,
        None if extend else known,
        high_pass,
        read_image,
        read_filtered,
        read_mask,
        options,
    )
    # a reference view is its own measurement
    usable = np.flatnonzero(search.templates.usable)
    parts = [
        _Found(
            track=usable,
            image=seeds.references.image_idx[usable],
            xy=seeds.references.xy[usable],
            sigma=np.full(len(usable), np.nan),
            predicted=0,
        )
    ]
    for done, part in enumerate(parallel_map(search, range(len(cameras))), start=1):
        parts.append(part)
        if progress is not None:
            progress(done, len(cameras))
    return _assembled(observations.num_images, parts, seeds.references, cameras, options, high_pass)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Found:
    """What one image has added."""

    track: Int
    image: Int
    xy: Float
    sigma: Float
    predicted: int


class _Search:
    """Looks for the points in one image after another.

    Pickled for another process it makes the templates there, from the images: they are larger than
    all that they are made of.
    """

    def __init__(
        self,
        cameras: OrthographicCameras,
        seeds: Seeds,
        known: Observations | None,
        high_pass: float,
        read_image: Callable[[int], Array],
        read_filtered: Callable[[int, float], Array],
        read_mask: Callable[[int], Bool | None],
        options: GuidedOptions,
    ) -> None:
        self.given = cameras, seeds, known, high_pass, read_image, read_filtered, read_mask, options
        self.templates = reference_templates(seeds.references, read_filtered, high_pass, options)

    def __reduce__(self) -> tuple[object, ...]:
        return _Search, self.given

    def __call__(self, i: int) -> _Found:
        cameras, seeds, known, high_pass, read_image, read_filtered, read_mask, options = self.given
        size = read_image(i).shape[::-1]
        where = predict(i, cameras, seeds.points, seeds.normals, seeds.references, size, options)
        if known is not None:
            where = where.at(known.select(known.image_idx == i))
        filtered = read_filtered(i, high_pass)
        return _find_in(i, filtered, read_mask(i), where, self.templates, options)


def _find_in(
    i: int,
    filtered: Array,
    mask: Bool | None,
    where: Predictions,
    templates: Templates,
    options: GuidedOptions,
) -> _Found:
    """Align the patches of the points that should be seen in image i to its filtered pixels."""
    alignment = align_patches(
        templates,
        where.track_idx,
        filtered,
        where.xy,
        where.warp,
        max_shift_px=options.max_shift_px,
        min_correlation=options.min_correlation,
    )
    found = alignment.found & _inside(mask, alignment.xy)
    return _Found(
        track=where.track_idx[found],
        image=np.full(int(found.sum()), i),
        xy=alignment.xy[found],
        sigma=np.sqrt(0.5 * np.trace(alignment.covariance[found], axis1=1, axis2=2)),
        predicted=len(where.track_idx),
    )


def _inside(mask: Bool | None, xy: Float) -> Bool:
    if mask is None:
        return np.ones(len(xy), dtype=bool)
    column, row = np.nan_to_num(xy).astype(int).T
    return np.asarray(
        mask[np.clip(row, 0, mask.shape[0] - 1), np.clip(column, 0, mask.shape[1] - 1)]
    )


def _assembled(
    num_images: int,
    parts: list[_Found],
    references: References,
    cameras: OrthographicCameras,
    options: GuidedOptions,
    high_pass: float,
) -> Grown | None:
    track = np.concatenate([p.track for p in parts])
    image = np.concatenate([p.image for p in parts])
    order = np.lexsort((image, track))
    sigma = np.concatenate([p.sigma for p in parts])
    if np.isnan(sigma).all():
        return None
    # a reference view is as sure as a typical one
    sigma = np.where(np.isnan(sigma), np.nanmedian(sigma), sigma)
    direction = cameras.viewing_direction
    d_ref = direction[references.image_idx[track]]
    sine = np.linalg.norm(np.cross(d_ref, direction[image]), axis=1)
    raw = Observations(
        image_idx=image[order],
        track_idx=track[order],
        keypoint_idx=np.arange(len(order)),
        # as a COLMAP database will hold them
        xy=np.concatenate([p.xy for p in parts])[order].astype(np.float32).astype(np.float64),
        num_images=num_images,
        num_tracks=int(track.max(initial=-1)) + 1,
    )
    long, _ = keep_tracks(raw, np.ones(len(raw), bool), min_length=options.min_track_length)
    if not len(long):
        return None
    distinct = distinct_tracks(long, options.min_separation_px)
    kept, _ = keep_tracks(long, distinct[long.track_idx])
    rows = order[kept.keypoint_idx]
    # numbers within each image
    keypoint = np.zeros(len(kept), dtype=np.int64)
    for i in range(num_images):
        mine = np.flatnonzero(kept.image_idx == i)
        keypoint[mine] = np.arange(len(mine))
    return Grown(
        observations=replace(kept, keypoint_idx=keypoint),
        sigma_px=sigma[rows],
        baseline_sine=sine[rows],
        num_predicted=sum(p.predicted for p in parts),
        high_pass_px=high_pass,
    )
