"""Values by name that are worked out when they are asked for: a late judgement asks for few."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Generic, TypeVar

Value = TypeVar("Value")


class LazyMapping(Mapping[str, Value], Generic[Value]):
    """A mapping whose values are each worked out once, when first asked for.

    `work_out`: gives a name's value.

    >>> squares = LazyMapping(["2", "3", "4"], lambda name: int(name) ** 2)
    >>> squares["3"], "5" in squares, sum(squares.values())
    (9, False, 29)
    """

    def __init__(self, names: Iterable[str], work_out: Callable[[str], Value]) -> None:
        self._names, self._work_out = dict.fromkeys(names), work_out
        self._known: dict[str, Value] = {}

    def __getitem__(self, name: str) -> Value:
        if name not in self._known:
            if name not in self._names:
                raise KeyError(name)
            self._known[name] = self._work_out(name)
        return self._known[name]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)
