"""A detector of one's own: each rate against a limit, learned from healthy records.

gtmbench run --detector limit_check.py:LimitCheck
"""

from dataclasses import dataclass

import numpy as np

import gtmbench as gb


@dataclass(frozen=True)
class LimitCheck(gb.SimpleDetector):
    name: str = "limit check"
    channels: tuple[str, ...] = ("p", "q", "r")
    factor: float = 1.5
    memory_s: float = 0.0

    def learn(self, records):  # kept in the monitor's file
        return {name: self.factor * max(np.nanmax(np.abs(one[name])) for one in records) for name in self.channels}

    def scores(self, record, limits):  # an alarm where one rises above 1
        return {name: np.abs(record[name]) / limits[name] for name in self.channels}
