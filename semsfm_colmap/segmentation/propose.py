"""The proposal: which points of a cloud are specimen, and which hold it.

What touches the border of the images decides which kind of holder is looked for. Nothing touches
it: the specimen stands free and is whole. A little of the outline is touched: a coil or a stalk on
that side (`support`), a coil where it winds as a helix. Much of the outline is touched, or three of
its sides and no support shows: a substrate (`substrate`), or a field that is itself the specimen. A
random walker (`walker`) then gives each point to one of the two parts.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.normals import sampling_distance
from semsfm_colmap.segmentation import substrate, support
from semsfm_colmap.segmentation.contact import OUTWARD, BorderContact, find_contact
from semsfm_colmap.segmentation.labels import Labelling, whole
from semsfm_colmap.segmentation.names import COIL, NAMES, SPECIMEN, STALK, SUBSTRATE
from semsfm_colmap.segmentation.options import SegmentationOptions
from semsfm_colmap.segmentation.patches import connected_patches
from semsfm_colmap.segmentation.roughness import surface_variation
from semsfm_colmap.segmentation.walker import SEED_RATE, walk
from semsfm_colmap.types import Bool, Float, Int, OrthographicCameras, PointCloud

MIN_POINTS = 200
"""A smaller cloud shows no parts."""
MIN_DIRECTION = 0.7
"""A side whose outward normals average to less turns with the specimen: nothing holds it there."""
MIN_SUBSTRATE_SIDES = 3
"""A sheet under the specimen is seen on so many sides of it at least."""
SIDES = ("left", "right", "top", "bottom")


def propose(
    cloud: PointCloud,
    cameras: OrthographicCameras,
    image_size_px: Int,
    options: SegmentationOptions,
) -> Labelling:
    """Label each point of an oriented cloud.

    Parameters
    ----------
    cloud : N points with normals, world units
    cameras : M
    image_size_px : (M, 2) width, height

    """
    points = np.asarray(cloud.points)
    if cloud.normals is None:
        return whole(len(points), "the cloud has no normals, without which no part shows")
    if len(points) < MIN_POINTS:
        return whole(len(points), f"{len(points)} points are too few to tell parts apart")
    contact = find_contact(points, cameras, image_size_px, options)
    if not contact.touches.any():
        return whole(len(points), "nothing reaches the border of the images")
    spacing = sampling_distance(points)
    if contact.total_coverage > options.max_support_coverage:
        return _on_substrate(cloud, cameras, contact, spacing, options)
    found = _on_supports(cloud, contact, spacing, options)
    if (
        np.count_nonzero(contact.coverage) >= MIN_SUBSTRATE_SIDES
        and found.is_part("specimen").all()
    ):
        # a sheet of which stereo saw some
        sheet = _on_substrate(cloud, cameras, contact, spacing, options)
        return sheet if sheet.is_part("substrate").any() else found
    return found


def _on_substrate(
    cloud: PointCloud,
    cameras: OrthographicCameras,
    contact: BorderContact,
    spacing: float,
    options: SegmentationOptions,
) -> Labelling:
    points = np.asarray(cloud.points)
    sheet = substrate.find_substrate(
        points,
        np.asarray(contact.touches.any(axis=1)),
        cameras.viewing_direction.mean(axis=0),
        spacing,
        options,
    )
    if sheet is None:
        return whole(
            len(points), "the surface fills the images and nothing stands out of it: it is whole"
        )
    x = _settle(cloud, substrate.log_odds(sheet), sheet.level, sheet.raised, options)
    return _labelled(
        x,
        SUBSTRATE,
        f"the specimen stands {sheet.height[sheet.raised].max():.4g} above a substrate",
    )


def _on_supports(
    cloud: PointCloud, contact: BorderContact, spacing: float, options: SegmentationOptions
) -> Labelling:
    points, normals = np.asarray(cloud.points), np.asarray(cloud.normals)
    roughness = None
    labelling = whole(len(points), "what reaches the border of the images is no support")
    label, confidence = labelling.label.copy(), labelling.confidence.copy()
    said = []
    for side in range(len(OUTWARD)):
        touches, direction = contact.touches[:, side], contact.direction[side]
        if touches.sum() < support.MIN_SLICE_POINTS or np.linalg.norm(direction) < MIN_DIRECTION:
            continue
        found = support.find_support(points, normals, touches, direction, spacing, options)
        if found is None or found.carried.mean() < options.min_part_share:
            continue
        if roughness is None:
            roughness = surface_variation(points, normals, options.num_roughness_neighbors)
        x = _settle(cloud, support.log_odds(found, roughness), found.held, found.carried, options)
        number = STALK if found.phase is None else COIL
        part = x > 0.5
        label[part] = number
        confidence = np.where(part, x, np.minimum(confidence, 1.0 - x))
        said.append(f"a {NAMES[number]} on the {SIDES[side]}")
    if not said:
        return labelling
    return Labelling(label=label, confidence=confidence, names=NAMES, message=" and ".join(said))


def _settle(
    cloud: PointCloud, odds: Float, held: Bool, carried: Bool, options: SegmentationOptions
) -> Float:
    """Probability of each point to be of the holder."""
    prior = 1.0 / (1.0 + np.exp(-odds))
    prior = np.where(held, 1.0, np.where(carried, 0.0, prior))
    x = walk(
        np.asarray(cloud.points),
        np.asarray(cloud.normals),
        prior,
        np.where(held | carried, SEED_RATE, 1.0),
        smoothness=options.smoothness,
        num_neighbors=options.num_graph_neighbors,
    )
    return without_islands(np.asarray(cloud.points), x, held | carried, options)


def without_islands(points: Float, x: Float, given: Bool, options: SegmentationOptions) -> Float:
    """Turn over small patches of one label that hold no given one: (N,) probabilities."""
    x = x.copy()
    for inside in (x > 0.5, x <= 0.5):
        for patch in connected_patches(points, inside, options.num_graph_neighbors):
            if len(patch) < options.min_island_share * len(points) and not given[patch].any():
                x[patch] = 1.0 - x[patch]
    return x


def _labelled(x: Float, number: int, message: str) -> Labelling:
    return Labelling(
        label=np.where(x > 0.5, number, SPECIMEN),
        confidence=np.maximum(x, 1.0 - x),
        names=NAMES,
        message=message,
    )
