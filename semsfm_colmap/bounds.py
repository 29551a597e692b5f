"""What an option may be, said in its type and held when it is made.

`Annotated` bounds stand in the type of a field: whoever makes the options, flags, TOML or Python,
gets the same sentence, and help reads the same bounds.
"""

from __future__ import annotations

import math
import re
import types
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import cache
from numbers import Integral, Real
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Interval, MinLen

from semsfm_colmap.errors import UsageError
from semsfm_colmap.reprs import changed

Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Share = Annotated[float, Interval(ge=0, le=1)]
RelativeSigma = Annotated[float, Interval(ge=0, lt=1)]
Correlation = Annotated[float, Interval(ge=-1, le=1)]
Angle = Annotated[float, Interval(ge=0, le=180)]
Percentile = Annotated[float, Interval(ge=0, le=100)]
Count = Annotated[int, Ge(1)]
CountOrNone = Annotated[int, Ge(0)]
Seed = Annotated[int, Interval(ge=0, le=2**32 - 1)]
SomePositive = Annotated[tuple[Positive, ...], MinLen(1)]


class Checked:
    """Base of dataclasses of options: what is no value of its field is refused at construction.

    Shown are those that are not at their defaults.
    """

    def __init_subclass__(cls) -> None:
        cls.__repr__ = changed  # type: ignore[method-assign]  # dataclass keeps what is there

    def __post_init__(self) -> None:
        """Check every field, and what fields say of one another."""
        kind: Any = type(self)
        for name, hint in _hints(kind).items():
            value = plain(getattr(self, name), hint)
            object.__setattr__(self, name, value)
            hold(self._place(name), value, hint)
        for name, wanted in self.contradictions():
            raise UsageError(f"{self._place(name)} is {getattr(self, name)!r}: {wanted}")

    def contradictions(self) -> list[tuple[str, str]]:
        """Fields that contradict others, and what to do."""
        return []

    def _place(self, name: str) -> str:
        section = type(self).__name__.removesuffix("Options")
        words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", section).lower()
        return name if section == "Config" else f"{name} of the {words} options"


def hold(name: str, value: Any, hint: Any) -> None:
    """Refuse a value that its type does not hold, by its name."""
    wanted = fault(value, hint)
    if wanted:
        raise UsageError(f"{name} is {value!r}: give {wanted}")


@cache
def _hints(kind: Any) -> dict[str, Any]:
    hints = get_type_hints(kind, include_extras=True)
    return {one.name: hints[one.name] for one in fields(kind)}


def _bare(hint: Any) -> Any:
    """A type without its bounds and without None."""
    if get_origin(hint) is Annotated:
        return _bare(get_args(hint)[0])
    if get_origin(hint) in (Union, types.UnionType):
        return _bare(next(part for part in get_args(hint) if part is not type(None)))
    return hint


def plain(value: Any, hint: Any) -> Any:
    """A list in place of a tuple, and numpy's whole numbers, as what they stand for."""
    if isinstance(value, list) and get_origin(_bare(hint)) is tuple:
        return tuple(value)
    if isinstance(value, Integral) and not isinstance(value, int):
        return int(value)
    return value


def fault(value: Any, hint: Any) -> str:
    """What would be right, in words, where a value does not fit a type; else nothing."""
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        wanted = [fault(value, part) for part in get_args(hint)]
        named = [
            w for w, part in zip(wanted, get_args(hint), strict=True) if part is not type(None)
        ]
        return "" if "" in wanted else " or ".join(named)
    if origin is Annotated:
        kind, *rules = get_args(hint)
        if fault(value, kind) or not all(_holds(value, rule) for rule in rules):
            return described(hint)
        return ""
    if origin is tuple:
        parts = get_args(hint)
        if not isinstance(value, tuple):
            return described(hint)
        each = [parts[0]] * len(value) if parts[-1] is Ellipsis else list(parts)
        if len(each) != len(value):
            return described(hint)
        return next((w for w in map(fault, value, each) if w), "")
    if origin is Literal:
        return "" if value in get_args(hint) else described(hint)
    return "" if _is(value, hint) else described(hint)


def _is(value: Any, kind: Any) -> bool:
    if kind is type(None):
        return value is None
    if kind is float:
        return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
    if kind is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    return isinstance(value, kind)


def _holds(value: Any, rule: Any) -> bool:
    checks: dict[str, Callable[[Any], bool]] = {
        "gt": lambda bound: value > bound,
        "ge": lambda bound: value >= bound,
        "lt": lambda bound: value < bound,
        "le": lambda bound: value <= bound,
        "min_length": lambda bound: len(value) >= bound,
    }
    bounds = ((check, getattr(rule, name, None)) for name, check in checks.items())
    return all(check(bound) for check, bound in bounds if bound is not None)


def described(hint: Any) -> str:
    """A type in words: "a number above 0"."""
    kind = _bare(hint)
    if get_origin(kind) is Literal:
        return "one of " + ", ".join(str(choice) for choice in get_args(kind))
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        inner = described(parts[0])
        return f"one or more of: {inner}" if parts[-1] is Ellipsis else f"{len(parts)} of: {inner}"
    if isinstance(kind, type) and is_dataclass(kind):
        return f"{kind.__name__}(...)"
    names = {float: "a number", int: "a whole number", bool: "True or False", str: "a text",
             type(None): "None"}  # fmt: skip
    said = bounds_of(hint)
    return names.get(kind, "a path") + (f" {said}" if said else "")


def bounds_of(hint: Any) -> str:
    """The bounds of a number in words: "from 0 to 1"; empty where there are none."""
    if get_origin(hint) in (Union, types.UnionType):
        return next((said for part in get_args(hint) if (said := bounds_of(part))), "")
    if get_origin(hint) is not Annotated:
        return ""
    for rule in get_args(hint)[1:]:
        low, above = getattr(rule, "ge", None), getattr(rule, "gt", None)
        high, below = getattr(rule, "le", None), getattr(rule, "lt", None)
        if low is not None and high is not None:
            return f"from {low} to {high}"
        if above is not None:
            return f"above {above}" + (f", at most {high}" if high is not None else "")
        if low is not None:
            return f"of {low} or more" + (f", below {below}" if below is not None else "")
    return ""
