"""What a scenario expects of a detector: the tables ``[faults.expect.NAME]`` under a ``[[faults]]`` table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gtmbench.checks import keys, meant, number, shown, table_of, text
from gtmbench.errors import InputError
from gtmbench.values.channels import SENSORS, WHOLE, axis_of, names_of

_KEYS = ("detect_within_s", "isolate_as", "kind", "undetectable_because")
_OWN = {
    "channel": "the channel that the trial breaks",
    "axis": "it, or the other sensor of its axis",
    "sensor": "the sensor that it is a part of: magnetometer, gps, accelerometers",
}
_KNOWN = (*SENSORS, *WHOLE, *_OWN)


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """What a detector is expected to make of a trial.

    Attributes
    ----------
    detect_within_s : float or None
        From the onset to the alarm; None: however late.
    isolate_as : tuple of str
        One sensor: it is named in the end. Several: what the detector is left with lies within. Empty: whatever.
    kind : str or None
        The kind of fault in the end; None: whatever.
    undetectable_because : str
        Why no alarm is expected after the onset; empty where one is.
    """

    detect_within_s: float | None = None
    isolate_as: tuple[str, ...] = ()
    kind: str | None = None
    undetectable_because: str = ""


def expectations(where: str, given: Any, channel: str) -> dict[str, Expectation]:
    """Return what is expected of each detector of a trial that breaks a channel, by the detectors' names.

    Raises
    ------
    InputError
        Naming the table, the key, what was given and what is legal.

    Examples
    --------
    >>> expectations("faults, table 1", {"C": {"detect_within_s": 2.0, "isolate_as": "channel"}}, "p")["C"].isolate_as
    ('p',)
    """
    tables = table_of(f"{where}: expect", given, "[faults.expect.DETECTOR]")
    return {name: _expectation(f"{where}: expect.{name}", table, channel) for name, table in tables.items()}


def _expectation(where: str, given: Any, channel: str) -> Expectation:
    table = keys(table_of(where, given, "[faults.expect.DETECTOR]"), _KEYS, where=where, there="there are")
    if not table:
        raise InputError(f"{where} expects nothing; give {', '.join(_KEYS[:-1])}, or {_KEYS[-1]}")
    if "undetectable_because" in table:
        if len(table) > 1:
            others = ", ".join(key for key in table if key != "undetectable_because")
            raise InputError(f"{where}: undetectable_because and {others} contradict each other; keep one")
        return Expectation(undetectable_because=text(f"{where}: undetectable_because", table["undetectable_because"]))
    within = table.get("detect_within_s")
    return Expectation(
        detect_within_s=None if within is None else number(f"{where}: detect_within_s", within, 0.0, above=True),
        isolate_as=_sensors(f"{where}: isolate_as", table["isolate_as"], channel) if "isolate_as" in table else (),
        kind=text(f"{where}: kind", table["kind"]) if "kind" in table else None,
    )


def _sensors(where: str, given: Any, channel: str) -> tuple[str, ...]:
    """Return the sensors that are meant, each once."""
    named = given if isinstance(given, list) else [given]
    for name in named:
        if not isinstance(name, str) or name not in _KNOWN:
            own = ", ".join(f"'{word}' ({meaning})" for word, meaning in _OWN.items())
            known = f"there are {', '.join((*SENSORS, *WHOLE))}, and {own}{meant(name, _KNOWN)}"
            raise InputError(f"{where}: no sensor {shown(name)}; {known}")
    if not named:
        raise InputError(f"{where} is an empty list; name a sensor, or those that it may be left between")
    words = {"channel": (channel,), "axis": axis_of(channel), "sensor": names_of(channel)[-1:]}
    return tuple(dict.fromkeys(sensor for name in named for sensor in words.get(name, (name,))))
