"""What is said of a fault: parameters, as a class declares them among its fields, and when one comes and goes."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, field
from functools import lru_cache
from typing import cast, overload

import numpy as np

from gtmbench.checks import boolean, number, shown, whole
from gtmbench.errors import InputError
from gtmbench.faults.distortions import drawn
from gtmbench.values.clock import FloatArray, Value
from gtmbench.values.record import BoolArray


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A parameter of a kind of fault, beyond what every fault has."""

    name: str  # as the class's field, and as a scenario's key
    is_severity: bool  # Whether it tells how bad the fault is. Settings, seeds, flags and other channels don't.
    # float (a number), int (a whole number), bool (a flag) or str (the name of a channel that the fault reads)
    value_type: type = float
    unit: str | None = None  # of a number: its own unit ("" for none), or None for the channel's, divided by `per`
    per: str = ""  # "", or what the channel's unit is divided by: "s", "sqrt(s)", "g"
    # low, high, above: what a number may be: low..high, with `above` more than low
    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    default: object = MISSING  # what it is when nothing is said; `is_required` where something must be

    @property
    def is_required(self) -> bool:
        """Whether it has no default."""
        return self.default is MISSING

    @property
    def is_channel(self) -> bool:
        """Whether it names a channel that the fault reads beside its own."""
        return self.value_type is str

    @property
    def is_in_channels_unit(self) -> bool:
        """Whether it is a number in the channel's unit, perhaps divided by `per`."""
        return self.value_type is float and self.unit is None

    @property
    def per_second(self) -> bool:
        """Whether it is in the channel's unit per second, as slopes are."""
        return self.per == "s"

    def check(self, where: str, value: object) -> None:
        """Refuse a value that this parameter can't have; None is legal where it is the default."""
        key = f"{where}: {self.name}"
        if value is None and self.default is None:
            return
        if self.value_type is float:
            number(key, value, self.low, self.high, above=self.above)
        elif self.value_type is int:
            whole(key, value)
        elif not isinstance(value, self.value_type):
            legal = "a channel's name" if self.is_channel else "true or false"
            raise InputError(f"{key} is {shown(value)}; it must be {legal}")


def severity(
    *,
    per_second: bool = False,
    per: str = "",
    unit: str | None = None,
    low: float = -math.inf,
    high: float = math.inf,
    above: bool = False,
    default: object = MISSING,
) -> float:
    """Declare a field for the severity of a fault.

    Parameters
    ----------
    per_second : bool
        It is in the channel's unit per second; short for ``per="s"``.
    per : str
        The divisor of the channel's unit: "s", "sqrt(s)", "g"; by default none.
    unit : str
        Its own unit ("" for a plain number), if it doesn't use the channel's.
    low, high, above
        The allowed range: low..high, with `above` more than low.
    default
        The default value; without one it must be given.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import gtmbench as gb
    >>> @dataclass(frozen=True, kw_only=True)
    ... class Step(gb.Fault):
    ...     kind = "step"
    ...     size: float = gb.severity(low=0.0)
    >>> Step(channel="p", onset_s=1.0, size=2.0).severities
    {'size': 2.0}
    """
    limits = {"low": low, "high": high, "above": above}
    told = {"is_severity": True, "per": "s" if per_second else per, "unit": unit}
    declared: float = field(default=cast("float", default), metadata={**told, **limits})
    return declared


def setting(
    *, unit: str, low: float = -math.inf, high: float = math.inf, above: bool = False, default: object = MISSING
) -> float:
    """Declare a field for a number that isn't a severity: a frequency, a phase.

    Parameters
    ----------
    unit : str
        Its own.
    low, high, above, default
        As `severity` takes them.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import gtmbench as gb
    >>> @dataclass(frozen=True, kw_only=True)
    ... class Hum(gb.Fault):
    ...     kind = "hum"
    ...     frequency_hz: float = gb.setting(unit="Hz", low=0.0, default=50.0)
    >>> Hum(channel="p", onset_s=1.0).frequency_hz
    50.0
    """
    metadata = {"is_severity": False, "unit": unit, "low": low, "high": high, "above": above}
    declared: float = field(default=cast("float", default), metadata=metadata)
    return declared


def other_channel() -> str:
    """Declare a field for another channel that the fault reads.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import gtmbench as gb
    >>> @dataclass(frozen=True, kw_only=True)
    ... class Crosstalk(gb.Fault):
    ...     kind = "crosstalk"
    ...     of: str = gb.other_channel()
    >>> Crosstalk(channel="p", onset_s=1.0, of="q").reads
    ('p', 'q')
    """
    declared: str = field(metadata={"is_severity": False, "value_type": str})
    return declared


def flag() -> bool:
    """Declare a yes-or-no field of a fault; the default is no.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import gtmbench as gb
    >>> @dataclass(frozen=True, kw_only=True)
    ... class Blank(gb.Fault):
    ...     kind = "blank"
    ...     is_loud: bool = gb.flag()
    >>> Blank(channel="p", onset_s=1.0).is_loud
    False
    """
    return field(default=False, metadata={"is_severity": False, "value_type": bool})


def random_seed() -> int:
    """Declare a field for the seed of a fault's random draws; the default is 0.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import gtmbench as gb
    >>> @dataclass(frozen=True, kw_only=True)
    ... class Crackle(gb.Fault):
    ...     kind = "crackle"
    ...     seed: int = gb.random_seed()
    >>> Crackle(channel="p", onset_s=1.0).seed, Crackle(channel="p", onset_s=1.0, seed=7).seed
    (0, 7)
    """
    return field(default=0, metadata={"is_severity": False, "value_type": int})


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
