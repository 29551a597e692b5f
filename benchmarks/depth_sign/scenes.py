"""Simulated scenes, and what the cues say of the right hand in each."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from semsfm_colmap.geometry.alignment import CameraAlignment, align_cameras
from semsfm_colmap.refinement.depth_reversal import known_tilt_cue, visibility_cues
from semsfm_colmap.refinement.depth_reversal.decision import fused_logit
from semsfm_colmap.synthetic.light_shapes import Shape
from semsfm_colmap.synthetic.occluded_tracks import (
    OccludedScene,
    OccludedTracksOptions,
    noise_scene,
    simulate_occluded,
)

SHARES: dict[Shape, float] = {
    "bumpy": 0.205,
    "spiny": 0.17,
    "clump": 0.159,
    "field": 0.2,
    "crater": 0.1,
    "substrate": 0.16,
    "cup": 0.006,
}
"""One body in a hundred is a cup, a little fewer than CONVEX_MAX_LOGIT assumes; a table of their
own shows what becomes of them."""
KINDS = {
    "bumpy": "closed body",
    "spiny": "closed body",
    "clump": "closed body",
    "cup": "hollow body",
    "field": "field",
    "crater": "field",
    "substrate": "bodies on a substrate",
    "noise": "noise",
}
SIGMA_TILT_DEG = 0.5
TRAIN, TEST, HOLLOW, NOISE, THROUGH = 1, 11, 13, 14, 15
"""First number of the seed: which set a scene belongs to."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One scene: what the cues said of the right hand."""

    shape: str
    range_deg: float
    num_images: int
    num_points: int
    t: dict[str, float] = field(default_factory=dict)
    logit: dict[str, float] = field(default_factory=dict)
    body: bool = False
    """whether the cues that need background around the specimen counted"""

    @property
    def kind(self) -> str:
        """What the tables call it."""
        return KINDS[self.shape]

    def total(self, with_tilt: bool) -> float:
        """Log odds of the right hand, bounded as `decide_depth_sign` bounds them."""
        return fused_logit(
            {name: x for name, x in self.logit.items() if with_tilt or name != "known tilt"}
        )


def draw_options(rng: np.random.Generator, shape: Shape | None = None) -> OccludedTracksOptions:
    """One scene of the mixture."""
    kind = shape or str(rng.choice(list(SHARES), p=list(SHARES.values())))
    widest = 80.0 if kind in ("field", "crater", "substrate") else 90.0 if kind == "cup" else 360.0
    range_deg = float(np.exp(rng.uniform(np.log(10.0), np.log(widest))))
    fewest = max(3, int(np.ceil(range_deg / 12.0)) + 1)
    most = int(np.clip(range_deg / 1.5, fewest, 72))
    return OccludedTracksOptions(
        shape=kind,  # type: ignore[arg-type]
        range_deg=range_deg,
        num_images=int(rng.integers(fewest, most + 1)),
        num_points=int(np.exp(rng.uniform(np.log(2000.0), np.log(12000.0)))),
        detection=float(rng.uniform(0.3, 0.8)),
        limit_deg=float(rng.uniform(60.0, 78.0)),
        ridge_preference=float(0.4 * rng.normal()),
        track_length_deg=float(rng.uniform(8.0, 35.0)),
        noise_px=float(rng.uniform(0.15, 0.6)),
        shading_px=float(1.5 * rng.normal()),
        wrong_share=float(rng.uniform(0.0, 0.04)),
        rotation_error_deg=float(np.exp(rng.normal(-2.3, 0.8))),
        tilt_error=float(0.02 * rng.normal()),
    )


def measure(scene: OccludedScene, shape: str, range_deg: float, rng: np.random.Generator) -> Row:
    """The cues of a scene, with a known tilt read to half a degree."""
    sigma = np.radians(SIGMA_TILT_DEG)
    cues = visibility_cues(scene.cameras, scene.points, scene.observations, scene.image_size_px)
    tilt = scene.true_angle_rad + sigma * rng.normal(size=len(scene.cameras))
    if shape == "noise":  # a tilt that has nothing to do with the cameras
        tilt = rng.permutation(tilt)
    if range_deg < 150.0:  # stages tilt, they do not turn a specimen over
        cues["known tilt"] = known_tilt_cue(scene.cameras, tilt, scene.axis, float(sigma))
    near = cues["near side"]
    return Row(
        shape=shape,
        range_deg=range_deg,
        num_images=len(scene.cameras),
        num_points=len(scene.points),
        t={name: cue.t for name, cue in cues.items()},
        logit={name: cue.logit for name, cue in cues.items()},
        body=near.t != 0.0 and near.probability != 0.5,
    )


def simulate(group: int, k: int, shape: Shape | None = None) -> Row:
    """Scene k of a group."""
    rng = np.random.default_rng([group, k])
    options = draw_options(rng, shape)
    return measure(simulate_occluded(options, rng), options.shape, options.range_deg, rng)


def simulate_noise(k: int) -> Row:
    """Model k of noise."""
    rng = np.random.default_rng([NOISE, k])
    scene = noise_scene(int(rng.integers(3, 73)), int(rng.integers(300, 6000)), rng)
    return measure(scene, "noise", float(np.degrees(np.ptp(scene.true_angle_rad))), rng)


def through_the_pipeline(k: int) -> Row:
    """Scene k from its raw tracks through factorization, refinement and the decision."""
    from semsfm_colmap.factorization.options import FactorizationOptions
    from semsfm_colmap.mapping.parts import map_observations
    from semsfm_colmap.refinement.options import RefinementOptions

    rng = np.random.default_rng([THROUGH, k])
    options = draw_options(rng)
    scene = simulate_occluded(options, rng)
    names = tuple(f"{i:03d}.png" for i in range(options.num_images))
    solved = map_observations(
        scene.raw,
        names,
        scene.image_size_px,
        factorization=FactorizationOptions(),
        refinement=RefinementOptions(),
    )
    if solved.value is None:
        return Row(shape=options.shape, range_deg=options.range_deg, num_images=0, num_points=0)
    model = solved.value[0].reconstruction
    true = scene.true_cameras.select(np.array([int(n[:3]) for n in model.image_names]))
    as_it_is = align_cameras(model.cameras, true)
    twin = align_cameras(model.cameras, true, reverse_depth=True)
    right = error_of(as_it_is) <= error_of(twin)
    sign = model.depth_sign
    total = float(np.log(sign.confidence) - np.log1p(-sign.confidence))
    return Row(
        shape=options.shape,
        range_deg=options.range_deg,
        num_images=model.num_images,
        num_points=len(model.points),
        logit={"all": total if right else -total},
    )


def error_of(alignment: CameraAlignment) -> float:
    """Median rotation error of an alignment, rad."""
    return float(np.median(alignment.rotation_error_rad))
