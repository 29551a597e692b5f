"""Measured values and their uncertainty budgets as one self-contained page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from typing import Any

from semsfm_colmap.report.html_parts import Row, bullets, hint, image, section, table, text
from semsfm_colmap.report.number_text import fixed, measured, number

POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; form-action 'none'"
EXPLANATION = (
    "Standard uncertainties u are one σ (JCGM 100:2008). Kind A: from the scatter of the data; "
    "kind B: from what else is known (docs/truth.md, docs/surface_sigma.md). A contribution is the "
    "size of a source times the sensitivity of the value; contributions add in squares, the share "
    "is of that sum. Interval: value ± U, U = k u, k = 1.96, 95 % of a normal distribution."
)
SUPERSCRIPT = str.maketrans("23", "²³")


def unit_text(unit: str) -> str:
    """``um^2`` as a person writes it."""
    pretty = unit.replace("^", "").translate(SUPERSCRIPT) if "^" in unit else unit
    return pretty.replace("um", "µm").replace("deg", "°")


def measurements_page(
    data: Mapping[str, Any], title: str, pictures: Mapping[str, bytes] | None = None
) -> str:
    """The page of the content of measurements.json.

    Parameters
    ----------
    data : as `pipeline.measure` writes it
    title : of the project
    pictures : PNG of the images that something was picked in, by their names

    """
    ones = [*data["measurements"], *data["checks"]]
    body = f"<h1>Measurements: {text(title)}</h1>"
    body += section("Results", _results(ones) + bullets(_scale(data)), anchor="results")
    if pictures:
        drawn = "".join(image(png, f"{name}, px") for name, png in pictures.items())
        body += section("Places and regions", drawn, anchor="places")
    body += hint(EXPLANATION)
    body += "".join(_one(k, one) for k, one in enumerate(ones))
    body += section("Not assessed", _not_assessed(ones), anchor="not-assessed")
    style = resources.files("semsfm_colmap.report").joinpath("assets", "report.css")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{text(POLICY)}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Measurements: {text(title)}</title><style>{style.read_text('utf-8')}</style>"
        f"</head>\n<body><main>{body}</main></body></html>\n"
    )


def _scale(data: Mapping[str, Any]) -> list[str]:
    size = data["pixel_size_um"]
    known = "none is known: lengths are in px" if size is None else f"{number(size, 5)} µm"
    source = "" if size is None else f", {data['pixel_size_source']}"
    return [f"Pixel size: {known}{source}.", *data["notes"]]


def _results(ones: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for one in ones:
        low, high = one["interval_95"]
        u, check = one["standard_uncertainty"], one.get("check")
        digits = 5
        rows.append(
            Row(
                cells=(
                    one["name"],
                    one["what"],
                    measured(one["value"], u),
                    unit_text(one["unit"]),
                    f"{number(low, digits)} to {number(high, digits)}",
                    "" if check is None else f"{number(check['length'], digits)}",
                    "" if check is None else fixed(check["E_n"], 2),
                ),
                absent=check is not None and not check["agrees"],
            )
        )
    heads = ("name", "what", "value ± u", "unit", "95 % interval", "known", "Eₙ")
    return table(heads, rows, text_columns=(0, 1), label="Results")


def _one(k: int, one: Mapping[str, Any]) -> str:
    unit = unit_text(one["unit"])
    body = f"<p>{text(one['what'])}: <b>{text(measured(one['value'], one['standard_uncertainty']))}"
    body += f" {text(unit)}</b></p>"
    rows = [
        Row(
            cells=(
                source["source"],
                source["kind"],
                _size(source),
                _sensitivity(source, unit),
                number(source["contribution"]),
                fixed(100.0 * source["share"], 1),
            )
        )
        for source in one["budget"]
    ]
    total = number(one["standard_uncertainty"])
    rows.append(Row(cells=("combined standard uncertainty", "", "", "", total, "100.0")))
    heads = (
        "source", "kind", "standard uncertainty of it", "sensitivity",
        f"contribution, {unit}", "share %",
    )  # fmt: skip
    body += bullets(one["remarks"]) if one["remarks"] else ""
    body += table(heads, rows, text_columns=(0,), label=f"Budget of {one['name']}")
    body += bullets(f"{name.replace('_', ' ')}: {number(v, 4)}" for name, v in one["facts"].items())
    if one.get("profile"):
        body += _curve(one["profile"], unit)
    return section(one["name"], body, anchor=f"measurement-{k}")


def _size(source: Mapping[str, Any]) -> str:
    if source["size"] is None:
        return "many, jointly"
    if source["size_unit"] == "relative":
        return f"{number(100.0 * source['size'])} %"
    return f"{number(source['size'])} {unit_text(source['size_unit'])}"


def _sensitivity(source: Mapping[str, Any], unit: str) -> str:
    if source["sensitivity"] is None:
        return "–"
    of = "" if source["size_unit"] == "relative" else f" / {unit_text(source['size_unit'])}"
    return f"{number(source['sensitivity'])} {unit}{of}"


def _not_assessed(ones: Iterable[Mapping[str, Any]]) -> str:
    lines: dict[str, list[str]] = {}
    num = 0
    for one in ones:
        num += 1
        for line in one["not_assessed"]:
            lines.setdefault(line, []).append(one["name"])
    return bullets(
        line if len(names) == num else f"{line} ({', '.join(names)})"
        for line, names in lines.items()
    )


def _curve(rows: Sequence[Sequence[float]], unit: str) -> str:
    """Heights over the length, with the band of one standard deviation, as SVG."""
    width, height, left, low = 720.0, 220.0, 60.0, 30.0
    x = [row[0] for row in rows]
    top = max(row[1] + row[2] for row in rows)
    bottom = min(row[1] - row[2] for row in rows)
    span, length = max(top - bottom, 1e-300), max(x[-1] - x[0], 1e-300)

    def place(along: float, z: float) -> str:
        u = left + (width - left - 10.0) * (along - x[0]) / length
        v = 10.0 + (height - low - 10.0) * (top - z) / span
        return f"{u:.1f},{v:.1f}"

    line = " ".join(place(a, z) for a, z, _ in rows)
    band = " ".join(place(a, z + s) for a, z, s in rows)
    band += " " + " ".join(place(a, z - s) for a, z, s in reversed(rows))
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" width="{width:g}" role="img" font-size="12" '
        'fill="currentColor" style="max-width: 100%" '
        f'aria-label="Profile: heights over the length in {text(unit)}">'
        f'<polygon points="{band}" fill="var(--accent)" fill-opacity="0.2"/>'
        f'<polyline points="{line}" fill="none" stroke="var(--accent)" stroke-width="1.5"/>'
        f'<text x="4" y="18">{text(number(top))}</text>'
        f'<text x="4" y="{height - low:g}">{text(number(bottom))}</text>'
        f'<text x="{left:g}" y="{height - 8:g}">0</text>'
        f'<text x="{width - 10:g}" y="{height - 8:g}" text-anchor="end">'
        f"{text(number(x[-1]))} {text(unit)}</text></svg>"
    )
