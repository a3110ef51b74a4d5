"""Parameters of a kind of fault: how a class declares them among its fields, and what they may be."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, field
from typing import cast

from gtmbench.checks import number, shown, whole
from gtmbench.errors import InputError


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
