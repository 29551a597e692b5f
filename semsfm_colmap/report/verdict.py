"""The numbers as plain sentences: what was measured, how far to trust it, what to do next."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from semsfm_colmap.report.doubt import Doubt
from semsfm_colmap.report.doubts import find_doubts
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.motion_statistics import RotationMetrics
from semsfm_colmap.report.number_text import count, fixed, measured, number, unit_text
from semsfm_colmap.report.trust_text import SAID_OF_THE_RUN, SAME_RANGE, trust_sentences

CHECK_A_LENGTH = (
    "Compare a length that you know, for a formal σ is not an accuracy (`semsfm measure`)."
)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The box at the top of the report, and the end of a command."""

    measured: tuple[str, ...]
    trust: tuple[str, ...]
    doubts: tuple[Doubt, ...]
    """the largest first"""

    @property
    def next(self) -> tuple[str, ...]:
        """What to do: what settles the doubts, each once; of a sound model, a check by hand."""
        actions = dict.fromkeys(f"{d.action[:1].upper()}{d.action[1:]}." for d in self.doubts)
        return tuple(actions) or (CHECK_A_LENGTH,)

    def not_said(self, notes: tuple[str, ...]) -> tuple[str, ...]:
        """The notes of the run that no sentence of the verdict says already."""
        covered = tuple(start for doubt in self.doubts for start in doubt.covers)
        return tuple(note for note in notes if not note.startswith(covered + SAID_OF_THE_RUN))


def _measured(m: Metrics) -> Iterator[str]:
    images, structure, world, r = m.images, m.structure, m.world, m.residuals
    registered = f"{images.num_registered} of {count(images.num_given, 'image')} registered"
    if structure.num_observations == 0:
        yield f"{registered}; {count(structure.num_points, 'point')}."
    else:
        yield (
            f"{registered}; {count(structure.num_points, 'point')} from "
            f"{count(structure.num_observations, 'observation')}, each seen in "
            f"{number(structure.mean_track_length)} images on average."
        )
    if m.rotation is not None:
        yield from _of_motion(m, m.rotation)
    if world.unit == "um":
        nm = f"one pixel is {number(world.pixel_size_nm, 4)} nm"
        yield f"The model is in micrometres: {nm} ({world.pixel_size_source})."
    else:
        yield "The model is in pixels: no pixel size is known."
    if m.mesh is not None and m.mesh.bounding_box is not None:
        mesh, u = m.mesh, unit_text(world.unit)
        size = " × ".join(number(s) for s in m.mesh.bounding_box.size_world)
        yield (
            f"The mesh has {count(mesh.num_faces, 'face')} in "
            f"{count(mesh.num_components, 'component')}, an area of "
            f"{number(mesh.area_world2)} {u}², and fits a box of {size} {u}."
        )
    if r is not None:
        nm = (
            f" ({number(r.x.sigma_nm, 2)} nm in x, {number(r.y.sigma_nm, 2)} nm in y)"
            if r.x.sigma_nm is not None
            else ""
        )
        yield (
            f"Residuals have σ = {number(r.x.sigma_px, 2)} px in x and "
            f"{number(r.y.sigma_px, 2)} px in y{nm}, over "
            f"{count(r.num_residuals, 'kept observation')}."
        )


def _of_motion(m: Metrics, rotation: RotationMetrics) -> Iterator[str]:
    sigma = None
    trust = m.reliability
    if trust is not None and abs(trust.total_rotation_deg - rotation.range_deg) < (
        SAME_RANGE * rotation.range_deg
    ):
        sigma = trust.total_rotation_sigma_deg
    yield (
        f"The specimen turned through {measured(rotation.range_deg, sigma)}° about one axis, "
        f"in steps of {number(rotation.median_step_deg)}° (median), with a wobble of "
        f"{fixed(rotation.wobble_rms_deg, 2)}° rms."
    )
    closing = rotation.closure
    if closing.is_full_turn:
        yield (
            f"It is a full turn: the step from the last image to the first is "
            f"{number(closing.last_to_first_deg)}°, against a median step of "
            f"{number(closing.median_step_deg)}°."
        )


def judge(metrics: Metrics) -> Verdict:
    """What the metrics say."""
    return Verdict(
        measured=tuple(_measured(metrics)),
        trust=tuple(trust_sentences(metrics)),
        doubts=tuple(find_doubts(metrics)),
    )
