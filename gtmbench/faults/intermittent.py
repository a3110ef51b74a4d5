"""Faults that come and go."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import overload

import numpy as np

from gtmbench.checks import boolean, number, whole
from gtmbench.faults.distortions import drawn
from gtmbench.values.clock import FloatArray, Value
from gtmbench.values.record import BoolArray

SLACK_S = 1e-9  # a time counts as reached up to a nanosecond before it
_CHANGES = 64  # that are drawn at first


@dataclass(frozen=True, kw_only=True)
class Intermittent:
    """The schedule of an intermittent fault: on once a period, for a share of it.

    In period n = 0, 1, ... after the onset the fault is on for

        (n + j u(n)) T <= t - onset < (n + j u(n) + d) T,

    T its period, d its duty, j its jitter, u(n) drawn evenly from [0, 1), but u(0) = 0: it begins at its onset. Or it
    heals and fails by chance: spells last d T on average, pauses (1 - d) T, each drawn from an exponential law.

    Parameters
    ----------
    period_s : float
        T, in seconds.
    duty : float
        d, the share of each period in which the fault is on: more than 0, at most 1.
    jitter : float
        j, the share of the period by which starts vary: at most 1 - d, so each spell stays in its own period.
    seed : int
        Of the beginnings.
    by_chance : bool
        Whether spells and pauses are of any length; then there is no jitter.

    Raises
    ------
    InputError
        If a value is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> gb.Intermittent(period_s=2.0, duty=0.5).is_on(np.arange(5.0))
    array([ True, False,  True, False,  True])
    """

    period_s: float
    duty: float
    jitter: float = 0.0
    seed: int = 0
    by_chance: bool = False

    def __post_init__(self) -> None:
        number("intermittent: period_s", self.period_s, 0.0, above=True)
        duty = number("intermittent: duty", self.duty, 0.0, 1.0, above=True)
        number("intermittent: jitter", self.jitter, 0.0, 0.0 if self.by_chance else 1.0 - duty + 1e-9)
        boolean("intermittent: by_chance", self.by_chance)
        whole("intermittent: seed", self.seed)

    @overload
    def is_on(self, elapsed_s: float) -> bool: ...
    @overload
    def is_on(self, elapsed_s: FloatArray) -> BoolArray: ...
    def is_on(self, elapsed_s: Value) -> bool | BoolArray:
        """Return whether the fault is on at a time after its onset, for a float or an array of increasing times."""
        if self.by_chance:
            is_on = self._is_on_by_chance(elapsed_s)
            return bool(is_on) if isinstance(elapsed_s, float) else is_on
        since_s = self._since_s(elapsed_s)
        return (since_s >= -SLACK_S) & (since_s < self.duty * self.period_s - SLACK_S)

    def _is_on_by_chance(self, elapsed_s: float | FloatArray) -> BoolArray:
        """Return whether an even number of changes has been, the first of which ends the first spell."""
        longest_s, count = float(np.max(elapsed_s, initial=0.0)), _CHANGES
        changes_s = _changes_s(self, count)
        while changes_s[-1] <= longest_s:
            count *= 2
            changes_s = _changes_s(self, count)
        changes = np.searchsorted(changes_s, np.asarray(elapsed_s) + SLACK_S, side="right")
        return np.asarray((changes % 2 == 0) & (np.asarray(elapsed_s) >= -SLACK_S))

    def _since_s(self, elapsed_s: Value) -> Value:
        """Return the time since the spell of a period began."""
        period = (elapsed_s + SLACK_S) // self.period_s
        period = period * (period > 0.0)  # before the onset there is none
        late = self.jitter * drawn("random", self.seed, "intermittent", period) * (period > 0.0) if self.jitter else 0.0
        return elapsed_s - (period + late) * self.period_s


@lru_cache(maxsize=64)
def _changes_s(times: Intermittent, count: int) -> FloatArray:
    """Return when the first spells and pauses end, in turn."""
    drawn_evenly = drawn("random", times.seed, "intermittent by chance", np.arange(float(count)))
    means_s = times.period_s * np.where(np.arange(count) % 2 == 0, times.duty, 1.0 - times.duty)
    return np.cumsum(-means_s * np.log1p(-drawn_evenly))
