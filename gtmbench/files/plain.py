"""Plain JSON: what values become, and how it is written. NaN and infinities never get into a file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any


def exact(value: Any) -> Any:
    """Return a value for a file that is read back bit for bit: arrays and tuples as lists, numpy's numbers as Python's.

    Anything else stays what it is: `dumps` refuses what JSON can't hold, so that nothing is lost in silence.

    >>> import numpy as np
    >>> exact({"limits": np.array([1.0, 2.0]), "w": np.int64(3)})
    {'limits': [1.0, 2.0], 'w': 3}
    """
    if hasattr(value, "tolist"):  # numpy's arrays and numbers
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: exact(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [exact(entry) for entry in value]
    return value


def finite_or_none(value: Any) -> Any:
    """Return what is neither table nor list as a report has it: NaN and infinities as None, a path or a name as words.

    >>> finite_or_none(math.nan), finite_or_none(True), finite_or_none(1j)
    (None, True, '1j')
    """
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, str | int | float | None) else str(value)


def plain(value: Any, leaf: Callable[[Any], Any] = finite_or_none) -> Any:
    """Return a value for a report: tables of words, lists, and leaves as `leaf` writes them; dataclasses are tables.

    >>> import numpy as np
    >>> plain({"sigma": np.array([1.0, np.nan]), 3: ("a", None)})
    {'sigma': [1.0, None], '3': ['a', None]}
    """
    if isinstance(value, Mapping):
        return {str(key): plain(entry, leaf) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry, leaf) for entry in value]
    if hasattr(value, "tolist"):  # of numpy and of pandas
        return plain(value.tolist(), leaf)
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name), leaf) for field in fields(value)}
    return leaf(value)


def dumps(value: Any, indent: int | None = None) -> str:
    """Write a plain value as JSON, keys in the order given; a ValueError where it holds NaN or infinities.

    >>> dumps({"b": 1, "a": [0.5]})
    '{"b": 1, "a": [0.5]}'
    """
    return json.dumps(value, indent=indent, allow_nan=False)
