"""The thrust that a throttle makes.

An engine follows its throttle late and not in proportion. With L the lag 1/(tau s + 1), once or twice, thrust is taken
to be

    h = (u + b u^2 / 100) / (1 + 2 b u0 / 100),   u = L throttle,

in percent of throttle at u0, the usual one. tau and b are identified from the forward acceleration
(`identification.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gtmbench.checks import number, whole
from gtmbench.detectors.tables import keys
from gtmbench.values.record import FloatArray

THROTTLE = "throttle"
STEP_PERCENT = 20.0  # of throttle, beside a degree of a surface: what is tolerated of either is alike
_MOST_LAG_S, _MOST_BEND = 60.0, 100.0  # beyond is a broken file: no engine is as slow, no thrust as bent


@dataclass(frozen=True, kw_only=True)
class Engine:
    """How thrust follows a throttle.

    >>> engine = Engine(lag_s=1.0, lags=2, bend=1.0, level=25.0)
    >>> (engine.thrust(np.array([26.0])) - engine.thrust(np.array([25.0]))).round(2)
    array([1.01])
    """

    lag_s: float  # tau
    lags: int = 1  # 1, or 2 in a row
    bend: float = 0.0  # b
    level: float = 0.0  # u0, in percent

    @property
    def slope(self) -> float:
        """Of thrust at the usual throttle, before it is made 1."""
        return 1.0 + 2.0 * self.bend * self.level / 100.0

    def thrust(self, lagged: FloatArray) -> FloatArray:
        """Return h of a throttle that is behind its lags, both in percent."""
        return np.asarray((lagged + self.bend * np.square(lagged) / 100.0) / self.slope)

    def table(self) -> dict[str, object]:
        """Return it as plain values."""
        return {"lag_s": self.lag_s, "lags": self.lags, "bend": self.bend, "level": self.level}


def engine_of(where: str, given: Any) -> Engine:
    """Return the engine of a table, every key checked. InputError naming the key, what stands there and what should."""
    table = keys(where, given, ("lag_s", "lags", "bend", "level"))
    return Engine(
        lag_s=number(f"{where}.lag_s", table["lag_s"], 0.0, _MOST_LAG_S, above=True),
        lags=whole(f"{where}.lags", table["lags"], 1, 2),
        bend=number(f"{where}.bend", table["bend"], -_MOST_BEND, _MOST_BEND),
        level=number(f"{where}.level", table["level"], -100.0, 100.0),
    )
