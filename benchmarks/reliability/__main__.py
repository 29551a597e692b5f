"""Kills, full disks, damaged files and bad input, with counts for docs/reliability.md.

Results are kept line by line in FOLDER: a run that was cut off goes on. Ends with exit code 1 where
anything was wrong, and says what.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

from benchmarks.reliability import damage, disks, inputs, kills
from benchmarks.reliability.projects import Series, make_series
from benchmarks.tables import add_page_option, parser, put, table

KINDS = ("damage", "disks", "kills", "inputs")
Result = dict[str, object]
Case = tuple[str, Callable[[], Result]]


def measured(path: Path, cases: list[Case]) -> list[Result]:
    """The results of all cases, those of an earlier run included."""
    lines = path.read_text().splitlines() if path.is_file() else []
    known = {str(row["case"]): row for row in map(json.loads, lines)}
    results = []
    for name, do in cases:
        if name not in known:
            known[name] = {"case": name, **do()}
            with path.open("a") as file:
                file.write(json.dumps(known[name]) + "\n")
            print(f"{name}: {known[name]['wrong'] or 'right'}", file=sys.stderr, flush=True)
        results.append(known[name])
    return results


def tables(series: Series, folder: Path, only: list[str], number: int, seed: int) -> str:
    """All tables, or some of them."""
    blocks = []
    if "damage" in only:
        cases: list[Case] = [
            (f"{way}: {name}", lambda n=name, w=way: damage.damage(series, folder, n, w))  # type: ignore[misc]
            for name in damage.outputs(series)
            for way in damage.WAYS
        ]
        found = measured(folder / "damage.jsonl", cases)
        titles = ("every file of a project", "files", "made again, to the bit, and said")
        blocks.append(table(titles, damage.rows(found)))
    if "disks" in only:
        cases = [
            (f"disk {kb} kB", lambda kb=kb: disks.fill(series, folder, kb))  # type: ignore[misc]
            for kb in disks.sizes_kb(number)
        ]
        cases += [
            (f"limit {kb} kB", lambda kb=kb: disks.fill(series, folder, kb, limit=True))  # type: ignore[misc]
            for kb in disks.sizes_kb(max(number // 3, 1), 8.0, 1500.0)
        ]
        found = measured(folder / "disks.jsonl", cases)
        head = ("no space", "size", "runs", "too small", "one sentence, then the same to the bit")
        blocks.append(table(head, disks.rows(found)))
    if "kills" in only:
        times = kills.moments(series, folder, number, seed)
        cases = [
            (f"kill {k}", lambda m=m: kills.kill(series, folder, m))  # type: ignore[misc]
            for k, m in enumerate(times)
        ]
        found = measured(folder / "kills.jsonl", cases)
        blocks.append(table(("killed in", "kills", "then the same to the bit"), kills.rows(found)))
    if "inputs" in only:
        cases = [
            (row.what, lambda r=row: inputs.feed(series, folder, r))  # type: ignore[misc]
            for row in inputs.ROWS
        ]
        found = measured(folder / "inputs.jsonl", cases)
        blocks.append(table(("bad input", "what is said", "exit code"), inputs.rows(found)))
    return "\n\n".join(blocks)


def main() -> None:
    """Run the command."""
    arguments = parser("reliability", __doc__)
    arguments.add_argument("--only", nargs="+", choices=KINDS)
    arguments.add_argument("--number", type=int, default=50, help="of kills, and of disks")
    arguments.add_argument("--seed", type=int, default=0, help="of the moments of kills")
    arguments.add_argument("--images", type=Path, help="default: a series is rendered")
    arguments.add_argument("--output", type=Path, default=Path("build/reliability"))
    arguments.add_argument("options", nargs="*", help="of `semsfm reconstruct`, after --")
    add_page_option(arguments, "reliability")
    args = arguments.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    folder = args.output.resolve()
    series = make_series(folder, args.images, tuple(args.options))
    text = tables(series, folder, args.only or list(KINDS), args.number, args.seed)
    if args.markdown is not None:
        put(args.markdown, "reliability", text)
    else:
        print(text)
    kept = [json.loads(line) for p in folder.glob("*.jsonl") for line in p.read_text().splitlines()]
    wrong = [row for row in kept if row["wrong"]]
    for row in wrong:
        print(f"{row['case']}: {'; '.join(map(str, row['wrong']))}", file=sys.stderr)
    if wrong:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
