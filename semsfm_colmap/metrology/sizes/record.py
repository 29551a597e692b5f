"""Measurements as measurements.json and measurements.csv hold them."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from semsfm_colmap.io.csv_cells import safe_cell
from semsfm_colmap.metrology.sizes.budget import COVERAGE_FACTOR, Measurement
from semsfm_colmap.metrology.sizes.requests import MeasurementRequest, Requests
from semsfm_colmap.types import Reconstruction

FORMAT = "semsfm-measurements"
VERSION = 1


def plain(
    model: Reconstruction,
    requests: Requests,
    found: Sequence[Measurement],
    checks: Sequence[Measurement],
    notes: Sequence[str],
) -> dict[str, Any]:
    """The content of measurements.json."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "pixel_size_um": model.pixel_size_um,
        "pixel_size_source": model.pixel_size_source,
        "notes": list(notes),
        "measurements": [entry(*both) for both in zip(found, requests.measurements, strict=True)],
        "checks": [entry(*both) for both in zip(checks, requests.checks, strict=True)],
    }


def entry(one: Measurement, request: MeasurementRequest) -> dict[str, Any]:
    """One measurement as JSON holds it."""
    out: dict[str, Any] = {
        "name": one.name,
        "what": one.what,
        "where": [
            {"image": corners[0].image, "xy": [list(corner.xy) for corner in corners]}
            for corners in request.outlines()
        ],
        "value": one.value,
        "unit": one.unit,
        "standard_uncertainty": one.sigma,
        "coverage_factor": COVERAGE_FACTOR,
        "expanded_uncertainty": one.expanded,
        "interval_95": list(one.interval),
        "facts": dict(one.facts),
        "remarks": list(one.remarks),
        "budget": [
            {
                "source": source.name,
                "kind": source.kind,
                "size": source.size,
                "size_unit": source.unit,
                "sensitivity": source.sensitivity,
                "contribution": source.contribution,
                "share": one.share(source),
            }
            for source in one.sources
        ],
        "not_assessed": list(one.not_assessed),
    }
    if one.check is not None:
        out["check"] = {
            "length": one.check.length,
            "sigma": one.check.sigma,
            "deviation": one.check.deviation,
            "E_n": one.check.en,
            "agrees": one.check.agrees,
        }
    if one.profile:
        out["profile"] = [list(row) for row in one.profile]
    return out


def table(data: Mapping[str, Any]) -> str:
    """A CSV table, one line a value."""
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(
        ["name", "what", "value", "unit", "standard_uncertainty", "low_95", "high_95", "E_n"]
    )
    for one in (*data["measurements"], *data["checks"]):
        low, high = one["interval_95"]
        numbers = (f"{x:.6g}" for x in (one["standard_uncertainty"], low, high))
        en = f"{one['check']['E_n']:.3f}" if "check" in one else ""
        name = safe_cell(one["name"])
        rows.writerow([name, one["what"], f"{one['value']:.6g}", one["unit"], *numbers, en])
    return out.getvalue()
