"""Names of before: they go on for one release, and say what they are called now."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any


def warn(old: str, new: str, *, stacklevel: int = 3) -> None:
    """Say that a name will go."""
    warnings.warn(
        f"{old} is called {new} now; the old name goes with the next release", DeprecationWarning, stacklevel=stacklevel
    )


def renamed(old: str, new: str, made: Callable[[Any], Any] | None = None) -> Any:
    """Return a property under an old name that gives the attribute of a new one (``a.b``: of an attribute).

    Where that is another type than it was, `made` makes the old one from the object.

    >>> class Verdict:
    ...     delay_s = 1.0
    ...     delay = renamed("Verdict.delay", "delay_s")
    >>> with warnings.catch_warnings(record=True) as told:
    ...     warnings.simplefilter("always")
    ...     print(Verdict().delay, told[0].message)
    1.0 Verdict.delay is called delay_s now; the old name goes with the next release
    """

    def get(self: Any) -> Any:
        warn(old, new)
        if made is not None:
            return made(self)
        for name in new.split("."):
            self = getattr(self, name)
        return self

    return property(get, doc=f"Deprecated: `{new}`.")
