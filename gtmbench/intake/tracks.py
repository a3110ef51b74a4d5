"""Channels that share their stamps, as a log has them before they are brought to one clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.clock import FloatArray

SHORTEST_S, FEWEST = 2.0, 20  # of a segment


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """Channels that share their stamps."""

    channels: tuple[str, ...]
    time_s: FloatArray  # increasing, shape (samples,)
    values: FloatArray  # shape (samples, channels)
    logged_s: float = 0.0  # where repeats were left out, the period that it was logged at with them; else 0

    @cached_property
    def period_s(self) -> float:
        """The median step."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def slowness_s(self) -> float:
        """The period that it asks of a record: of what says how it turns the true one, of others that of the log."""
        turns = {*GYROS, *ATTITUDE} & {*self.channels}
        return self.period_s if turns or not self.logged_s else self.logged_s

    @property
    def label(self) -> str:
        """Its channels, as a message names them."""
        more = f" and {len(self.channels) - 4} more" if len(self.channels) > 4 else ""
        return ", ".join(self.channels[:4]) + more

    def only(self, channels: Sequence[str]) -> Track:
        """Return some of its channels."""
        columns = [self.channels.index(name) for name in channels]
        together = slice(columns[0], columns[-1] + 1) if columns else slice(0)
        are_together = columns == list(range(together.start or 0, together.stop))
        return replace(self, channels=tuple(channels), values=self.values[:, together if are_together else columns])

    def split(self, channels: Sequence[str]) -> list[Track]:
        """Return it with some channels apart from the others; itself where it has only one or the other."""
        own = [name for name in self.channels if name in channels]
        rest = [name for name in self.channels if name not in channels]
        return [self.only(own), self.only(rest)] if own and rest else [self]

    def part(self, first: int, last: int) -> Track:
        """Return the samples from first to before last."""
        return replace(self, time_s=self.time_s[first:last], values=self.values[first:last])
