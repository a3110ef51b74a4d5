"""Who may be behind a change of the answer: a surface that isn't where it was commanded, or a sensor that is off.

Of either kind it is said in one way: what stands in the log is wrong by a + b x + c x', x what it reads there. A sensor
is biased by a, has another gain, or is stuck (b = 1). A surface is off by -a, lacks the share b of its command - all of
it, stuck or floating (b = 1), wherever it then is, at its end too - or follows late, by c seconds. What other relations
exclude of a sensor, by where they call it clear, is all that it may be off by here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.surfaces.commanded import Commanded
from gtmbench.detectors.surfaces.equations import SLOW_ENGINE_S, SLOW_S
from gtmbench.detectors.surfaces.thrust import STEP_PERCENT, THROTTLE
from gtmbench.values.channels import COMMANDS
from gtmbench.values.record import FloatArray

_OFF_DEG, _LACKS, _LATE_S = 10.0, 1.0, 1.0  # a surface's a, b and c: standard deviations about zero
_ANY = 1e6  # of a sensor that nothing else holds
_EXCLUDED = 0.5  # of what is excluded in 95 of 100
_ENDS = "altitude"  # a thousand feet change the answer by 3 %


@dataclass(frozen=True, kw_only=True, eq=False)
class Culprit:
    """Who may be behind it."""

    name: str  # a channel
    wrong: tuple[FloatArray, ...] = field(repr=False)  # shape (samples,): what its reading may be off by, of size one
    spread: FloatArray  # shape (wrong,): how large each may be: standard deviations about zero
    is_surface: bool

    def allows(self, sizes: FloatArray, used: tuple[int, ...]) -> bool:
        """Tell whether sizes can be: a surface doesn't answer backwards, more than all, or early."""
        found = dict(zip(used, sizes.tolist(), strict=True))
        return not self.is_surface or (0.0 <= found.get(1, 0.0) <= _MOST and found.get(2, 0.0) >= 0.0)

    @property
    def share(self) -> float:
        """By how much of an error it is worked out what that changes: of a command by all, for thrust is curved."""
        return -1.0 if self.is_surface else 1e-2

    @property
    def ways(self) -> tuple[tuple[int, ...], ...]:
        """Which of the errors may be there together."""
        return ((0,), (0, 1), (0, 2), (0, 1, 2)) if self.is_surface else ((0,), (0, 1))


_MOST = 1.3  # of a share: what is fitted is noisy


def suspects_of(commanded: Commanded, until_s: float, excluded: Mapping[str, float]) -> Iterator[Culprit]:
    """Give everybody who may be behind a change after some time.

    `excluded`, by channel: the largest error of sensors that may hide, where others call them clear, in their unit.
    """
    healthy = commanded.until(until_s)
    for name in commanded.channels:
        read, ones = commanded.column(name), np.ones(len(commanded.values))
        from_mean = read - healthy.column(name).mean()
        if name in commanded.frame.surfaces:
            slow_s, unit = (SLOW_ENGINE_S, STEP_PERCENT) if name == THROTTLE else (SLOW_S, 1.0)
            late = (read - _behind(read, np.exp(-commanded.period_s / slow_s))) / slow_s
            spread = np.array([_OFF_DEG * unit, _LACKS, _LATE_S])
            yield Culprit(name=name, wrong=(ones, from_mean, late), spread=spread, is_surface=True)
        elif name not in (*COMMANDS, _ENDS):
            most = _EXCLUDED * excluded.get(name, _ANY)
            spread = np.array([most, most / max(float(healthy.column(name).std()), 1e-9)])
            yield Culprit(name=name, wrong=(ones, from_mean), spread=spread, is_surface=False)


def _behind(values: FloatArray, pole: float) -> FloatArray:
    from scipy.signal import lfilter  # half a second to import

    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], values - values[0]) + values[0])
