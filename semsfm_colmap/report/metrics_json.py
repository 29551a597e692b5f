"""The shape of metrics.json: every key that `docs/report.md` explains is given here.

Most parts are the fields of their dataclasses under the same names. What is written out below
differs: nested parts that lie flat in the file, and what stands for a part without data.
"""

from __future__ import annotations

from typing import Any

from semsfm_colmap.records import PairStatistics, known_only, to_plain
from semsfm_colmap.report.filtering_statistics import RoundMetrics
from semsfm_colmap.report.image_statistics import ImageMetrics
from semsfm_colmap.report.json_text import plain
from semsfm_colmap.report.match_statistics import MatchMetrics
from semsfm_colmap.report.mesh_statistics import MeshMetrics
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.motion_statistics import RotationMetrics
from semsfm_colmap.report.residual_statistics import AxisResiduals, ResidualMetrics
from semsfm_colmap.report.structure_statistics import StructureMetrics
from semsfm_colmap.report.verdict import Verdict, judge

FORMAT = "semsfm-metrics"
VERSION = 1
NO_ROTATION = {"axis_camera": None, "range_deg": 0.0, "closure": None, "stage_tilt": None}

Json = dict[str, Any]


def metrics_json(metrics: Metrics) -> Json:
    """The metrics as plain dicts and lists, ready for JSON."""
    m = metrics
    result: Json = plain(
        {
            "format": FORMAT,
            "version": VERSION,
            "verdict": _verdict(judge(m)),
            "images": to_plain(m.images),
            "world": to_plain(m.world),
            "structure": _structure(m.structure),
            "residuals": _residuals(m.residuals),
            "rotation": _rotation(m.rotation),
            "reliability": {} if m.reliability is None else known_only(m.reliability),
            "depth_sign": {
                "status": m.depth_sign.status,
                "confidence": m.depth_sign.confidence,
                "evidence": m.depth_sign.evidence,
                "message": m.depth_sign.message,
                "twin_written": m.twin_written,
            },
            "matches": _matches(m.matches),
            "filtering_rounds": [_round(r) for r in m.filtering_rounds],
            "guided": None if m.guided is None else to_plain(m.guided),
            "telecentric": {}
            if m.telecentric is None
            else {
                "focal_length_px": m.telecentric.focal_length_px,
                "max_deviation_px": m.telecentric.max_deviation_px,
            },
            "magnification_trend": None
            if m.magnification_trend is None
            else to_plain(m.magnification_trend),
            "mesh": None if m.mesh is None else _mesh(m.mesh),
            "cloud": None if m.cloud is None else to_plain(m.cloud),
            "stages": [to_plain(stage) for stage in m.stages],
            "versions": m.versions,
            "notes": m.notes,
            "per_image": [_image(image) for image in m.per_image],
            "co_visibility": to_plain(m.co_visibility),
        }
    )
    return result


def _verdict(verdict: Verdict) -> Json:
    doubts = [
        {"title": d.title, "size": d.size, "sentence": d.sentence, "action": d.action}
        for d in verdict.doubts
    ]
    return {
        "measured": verdict.measured,
        "trust": verdict.trust,
        "doubts": doubts,
        "next": verdict.next,
    }


def _structure(s: StructureMetrics) -> Json:
    data = to_plain(s)
    return data | (data.pop("sigma") or {})


def _residuals(r: ResidualMetrics | None) -> Json:
    if r is None:
        return {"num_residuals": 0}
    data = to_plain(r)
    del data["x"], data["y"]
    num = data.pop("num_residuals")
    return {"num_residuals": num, **_along("x", r.x), **_along("y", r.y), **data}


def _along(letter: str, r: AxisResiduals) -> Json:
    return {
        f"mean_{letter}_px": r.mean_px,
        f"sigma_{letter}_px": r.sigma_px,
        f"robust_sigma_{letter}_px": r.robust_sigma_px,
        f"mean_{letter}_nm": r.mean_nm,
        f"sigma_{letter}_nm": r.sigma_nm,
    }


def _rotation(r: RotationMetrics | None) -> Json:
    return dict(NO_ROTATION) if r is None else to_plain(r)


def _matches(m: MatchMetrics) -> Json:
    return to_plain(m) | {"rejected": [_rejected(pair) for pair in m.rejected]}


def _rejected(pair: PairStatistics) -> Json:
    """A pair with its counts in the order of the filters."""
    return {
        "image_name_1": pair.image_name_1,
        "image_name_2": pair.image_name_2,
        "num_matches": pair.num_matches,
        "num_static_rejected": pair.num_static_rejected,
        "num_after_affine_ransac": pair.num_after_affine_ransac,
        "num_after_distance_filter": pair.num_after_distance_filter,
        "failure": pair.failure,
    }


def _round(r: RoundMetrics) -> Json:
    return {
        **to_plain(r.record),
        "num_kept": r.num_kept,
        "num_dropped": r.num_dropped,
        "dropped_fraction": r.dropped_fraction,
    }


def _mesh(mesh: MeshMetrics) -> Json:
    data: Json = {
        "num_vertices": mesh.num_vertices,
        "num_faces": mesh.num_faces,
        "num_components": mesh.num_components,
    }
    if mesh.bounding_box is not None:
        data["largest_component_area_fraction"] = mesh.largest_component_area_fraction
    data |= {"num_open_edges": mesh.num_open_edges, "area_world2": mesh.area_world2}
    if mesh.bounding_box is not None:
        data |= {f"bounding_box_{key}": value for key, value in to_plain(mesh.bounding_box).items()}
    return data


def _image(image: ImageMetrics) -> Json:
    """One row, flat; images without a pose have only its first part."""
    return {
        "frame": image.frame,
        "name": image.name,
        "registered": image.pose is not None,
        **to_plain(image.matches),
        **({} if image.pose is None else to_plain(image.pose)),
    }
