"""All detectors and descriptors by name.

    features = extract("harris-hessian-laplace", "sift", image)

A union of detectors is written with plus signs, "harris-laplace+edge-laplace"; near duplicates are
merged. COLMAP's SIFT takes part by its regions, which the caller brings. What is asked for several
times on one image shares one scale space: see `PreparedImage`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.features import descriptors as library
from semsfm_colmap.features.affine import adapt
from semsfm_colmap.features.descriptors.projection import Projection, shipped_projection
from semsfm_colmap.features.frames import oriented_features, patches_of
from semsfm_colmap.features.laplace import detect_laplace
from semsfm_colmap.features.options import DescriptorOptions, DetectorOptions
from semsfm_colmap.features.pixels import distance_to_unusable, normalized_pixels
from semsfm_colmap.features.regions import Regions, concatenate
from semsfm_colmap.features.scale_space import ScaleSpace, build_scale_space
from semsfm_colmap.features.selection import inside, not_duplicated, rank_within, spread_evenly
from semsfm_colmap.types import Array, Bool, Features

AFFINE_ID_OFFSET = 3
"""detector_id of an affine-adapted kind is that of the kind plus this."""
CHUNK = 1024
"""Features described at a time: bounds the memory for patches."""

DETECTORS: dict[str, tuple[tuple[str, bool], ...]] = {
    "harris-affine": (("harris", True),),
    "harris-laplace": (("harris", False),),
    "hessian-affine": (("hessian", True),),
    "hessian-laplace": (("hessian", False),),
    "harris-hessian-laplace": (("harris", False), ("hessian", False)),
    "edge-laplace": (("edge", False),),
    "harris-hessian-affine": (("harris", True), ("hessian", True)),
}
"""Name -> kinds of points, and whether their shape is adapted."""

EXTERNAL = {"colmap-sift": 6, "colmap-sift-affine": 7, "colmap-sift-pooled": 8}
"""Detectors of COLMAP with their numbers: plain, with adapted shape, with domain-size pooling."""


@dataclass(frozen=True, kw_only=True)
class Descriptor:
    """How one descriptor is computed from patches."""

    function: Callable[[Array], Array]
    """(K, size, size) float32 -> (K, D) float32"""
    size: int
    extent: float = 1.0
    """Half width of the patch, in units of the described half width."""
    projection: str = "none"
    """"pca" or "whiten": a linear map learnt from data follows."""
    dimensions: int = 0
    """What is kept by "pca"."""
    unit_norm: bool = False
    """Normalise to length 1 after the projection."""
    colmap: bool = False
    """Fits COLMAP's table: 128 values, not negative, of length 1."""


DESCRIPTORS: dict[str, Descriptor] = {
    "sift": Descriptor(function=library.sift, size=32, extent=4.0 / 3.0, colmap=True),
    "rootsift": Descriptor(function=library.rootsift, size=32, extent=4.0 / 3.0, colmap=True),
    "gloh": Descriptor(
        function=library.gloh, size=34, projection="pca", dimensions=128, unit_norm=True
    ),
    "pca-sift": Descriptor(
        function=library.pca_sift, size=41, projection="pca", dimensions=36, unit_norm=True
    ),
    "cc": Descriptor(function=library.ncc, size=27),
    "steerable": Descriptor(function=library.steerable, size=41, projection="whiten"),
    "differential": Descriptor(function=library.differential, size=41, projection="whiten"),
    "moments": Descriptor(function=library.moments, size=41, projection="whiten"),
    "shape-context": Descriptor(function=library.shape_context, size=34),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedImage:
    """What detection and description share: scale space and distance to masked pixels."""

    space: ScaleSpace
    distance_px: Array


def prepare(
    image: Array, mask: Bool | None = None, options: DetectorOptions | None = None
) -> PreparedImage:
    """Scale space of an image (H, W) grey; mask (H, W) True where usable."""
    options = options or DetectorOptions()
    pixels = normalized_pixels(image, mask)
    space = build_scale_space(
        pixels, first_octave=options.first_octave, max_scale_px=options.max_scale_px
    )
    return PreparedImage(
        space=space, distance_px=distance_to_unusable((image.shape[0], image.shape[1]), mask)
    )


def detector_parts(name: str) -> tuple[tuple[str, bool], ...]:
    """Kinds and adaptation of a detector or a union; unknown names are refused.

    An external detector is a kind of its own.
    """
    parts: list[tuple[str, bool]] = []
    for single in name.split("+"):
        if single not in DETECTORS and single not in EXTERNAL:
            raise UsageError(
                f"there is no detector {single!r}; there are {', '.join([*DETECTORS, *EXTERNAL])}, "
                "and unions of them with +"
            )
        parts += [part for part in DETECTORS.get(single, ((single, False),)) if part not in parts]
    return tuple(parts)


def external_parts(name: str) -> tuple[str, ...]:
    """The external detectors in a union."""
    return tuple(kind for kind, _ in detector_parts(name) if kind in EXTERNAL)


def descriptor_entry(name: str) -> Descriptor:
    """The entry of a descriptor; unknown names are refused."""
    if name not in DESCRIPTORS:
        raise UsageError(f"there is no descriptor {name!r}; there are {', '.join(DESCRIPTORS)}")
    return DESCRIPTORS[name]


def detect(
    name: str,
    image: Array | PreparedImage,
    options: DetectorOptions | None = None,
    mask: Bool | None = None,
    external: Mapping[str, Regions] | None = None,
) -> Features:
    """Features of an image, without descriptors.

    Parameters
    ----------
    name : one of `DETECTORS` or `EXTERNAL`, or several joined by "+"
    image : (H, W) grey, or what `prepare` made of it
    mask : (H, W) True where usable; already in a prepared image
    external : what the external detectors of the union found in this image

    """
    options = options or DetectorOptions()
    parts = detector_parts(name)
    found = dict(external or {})
    missing = [kind for kind in external_parts(name) if kind not in found]
    if missing:
        raise UsageError(f"{missing[0]} is a detector of COLMAP: pass its regions as `external`")
    prepared = image if isinstance(image, PreparedImage) else prepare(image, mask, options)
    own = sorted({kind for kind, _ in parts} - set(EXTERNAL))
    if own:
        found |= detect_laplace(prepared.space, own, options)
    chosen: list[Regions] = []
    for kind, affine in parts:
        regions = found[kind].select(inside(found[kind], prepared.distance_px, options.margin))
        if affine:
            regions = adapt(prepared.space, regions, options)
            regions = replace_id(regions, AFFINE_ID_OFFSET)
        chosen.append(regions)
    regions = concatenate(chosen)
    rank = rank_within(regions.detector_id, regions.response)
    keep = not_duplicated(
        regions.xy,
        regions.scale_px,
        rank * len(parts) + regions.detector_id,
        distance=options.merge_distance,
        scale_ratio=options.merge_scale_ratio,
    )
    regions = regions.select(keep)
    rows = spread_evenly(
        regions, options.max_num_features, prepared.space.shape, options.grid_cells
    )
    return oriented_features(prepared.space, regions.select(rows), options)


def replace_id(regions: Regions, offset: int) -> Regions:
    """The same regions under a shifted detector number."""
    return replace(regions, detector_id=regions.detector_id + offset)


def raw_descriptors(
    name: str, image: PreparedImage, features: Features, options: DescriptorOptions
) -> Array:
    """Descriptors before their learnt projection: (K, D) float32."""
    entry = descriptor_entry(name)
    half_width = options.magnification * entry.extent
    K = len(features.scale_px)
    rows = []
    for begin in range(0, max(K, 1), CHUNK):
        chosen = slice(begin, min(begin + CHUNK, K))
        patches = patches_of(image.space, features, chosen, half_width, entry.size)
        rows.append(entry.function(patches))
    return np.concatenate(rows)


def describe(
    name: str,
    image: Array | PreparedImage,
    features: Features,
    options: DescriptorOptions | None = None,
    *,
    projection: Projection | None = None,
) -> Features:
    """The features with descriptors (K, D) float32 of the given kind.

    Parameters
    ----------
    name : one of `DESCRIPTORS`
    projection : principal components or whitening fitted on the series (`fit_projection`);
        default the shipped ones

    """
    options = options or DescriptorOptions()
    entry = descriptor_entry(name)
    prepared = image if isinstance(image, PreparedImage) else prepare(image)
    values = raw_descriptors(name, prepared, features, options)
    if entry.projection != "none":
        dimensions = options.pca_dimensions or entry.dimensions
        values = (projection or shipped_projection(name)).apply(values, dimensions)
        if entry.unit_norm:
            values /= np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-12)
    return replace(features, descriptors=values)


def extract(
    detector: str,
    descriptor: str,
    image: Array,
    *,
    detection: DetectorOptions | None = None,
    description: DescriptorOptions | None = None,
    mask: Bool | None = None,
) -> Features:
    """Detect and describe on one scale space."""
    prepared = prepare(image, mask, detection)
    features = detect(detector, prepared, detection)
    return describe(descriptor, prepared, features, description)
