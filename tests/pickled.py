"""A map whose function and items have gone through pickle, as to another process."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import cloudpickle


def pickled_map(function: Callable[[Any], Any], items: Iterable[Any], /) -> Iterator[Any]:
    """Results in the order of the items."""
    there = pickle.loads(cloudpickle.dumps(function))
    return (pickle.loads(pickle.dumps(there(pickle.loads(pickle.dumps(i))))) for i in items)
