"""A fault in a line of text: ``bias:r:size=2``, its kind, its channel and its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gtmbench.checks import listed, meant, number, shown
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.faults.intermittent import Intermittent
from gtmbench.faults.parameter import Parameter
from gtmbench.faults.registry import find_fault
from gtmbench.values.channels import breakable_list

_TIMES = ("onset_s", "duration_s", "ramp_s")
_HOW = "write KIND:CHANNEL:KEY=VALUE,..., such as bias:r:size=2"
_FLAGS = {"true": True, "false": False}
PREFIX = "px4_"


@dataclass(frozen=True, kw_only=True)
class Word:
    """A word of PX4's."""

    kind: str  # of ours
    parameters: Mapping[str, object] = field(default_factory=dict)  # of the kind, unless something else is given
    differs: str = ""  # where the two differ; "" where they don't


# PX4's developer guide, "System Failure Injection", says what each word means, and leaves to the simulator how it
# looks. Where a word says less than a kind, or something else, its row says so.
WORDS: Mapping[str, Word] = {
    "px4_off": Word(kind="dropout"),
    "px4_stuck": Word(kind="jam", differs="PX4 says the same value each time; which one is left to the simulator"),
    "px4_garbage": Word(
        kind="noise",
        parameters={"deviation": 500.0},
        differs="PX4 publishes random noise in place of readings; here it is normal, and added to them",
    ),
    "px4_wrong": Word(
        kind="bias", differs="PX4 says a wrong value that looks reasonable; here it is off by a size that you give"
    ),
    "px4_slow": Word(
        kind="stale",
        parameters={"hold_s": 0.1},
        differs="PX4 publishes at a lower rate; here the rate stays, and readings are repeated",
    ),
    "px4_delayed": Word(
        kind="delay", parameters={"delay_s": 0.5}, differs="PX4 says significantly late; here it is half a second"
    ),
    "px4_intermittent": Word(
        kind="dropout",
        parameters={"intermittent": Intermittent(period_s=2.0, duty=0.5, by_chance=True)},
        differs="PX4 doesn't say how often; here half of the time, for a second on average",
    ),
}


def fault(text: str, *, onset_s: float | None = None) -> Fault:
    """Return a fault that is given in a line, as ``--fault`` takes it.

    Parameters
    ----------
    text : str
        ``KIND:CHANNEL``, or a failure as PX4 calls it, such as ``px4_slow:CHANNEL``, and behind another colon the
        kind's parameters, ``duration_s`` and ``ramp_s``, between commas.
        Figures are in the channel's unit.
    onset_s : float, optional
        When it begins, where the text has no ``onset_s``.

    Raises
    ------
    InputError
        If there is no such kind or channel, a parameter is missing, unknown or can't be what it is, or no onset is
        given.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.fault("bias:r:size=2", onset_s=60)
    Bias(channel='r', onset_s=60.0, duration_s=None, ramp_s=0.0, intermittent=None, size=2.0)
    >>> gb.fault("drift:p:slope=0.1,duration_s=5,onset_s=20").duration_s
    5.0
    >>> gb.fault("jam:elevator", onset_s=20).channel
    'elevator'
    >>> gb.fault("px4_slow:q", onset_s=20).hold_s
    0.1
    """
    kind, _, rest = text.partition(":")
    channel, _, settings = rest.partition(":")
    where = f"fault {shown(text)}"
    if not channel.strip():
        raise InputError(f"{where} names no channel; {_HOW}")
    try:
        word = WORDS.get(kind.strip())
        if word is None and kind.strip().startswith(PREFIX):
            raise InputError(f"PX4 has no such failure; there are {listed(WORDS)}{meant(kind.strip(), WORDS)}")
        cls = find_fault(kind.strip() if word is None else word.kind)
        (name,) = breakable_list("its channel", [channel.strip()])
        given = _given(cls, settings, {} if word is None else word.parameters)
        given.setdefault("onset_s", onset_s)
        if given["onset_s"] is None:
            raise InputError("nothing says when it begins; add --onset SECONDS, or onset_s=SECONDS behind the channel")
        given["onset_s"] = number("onset_s", given["onset_s"], 0.0)
        return cls(channel=name, **given)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _given(cls: type[Fault], text: str, usual: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters and times that a text gives, and others as usual."""
    parameters = {item.name: item for item in cls.parameters()}
    given: dict[str, Any] = dict(usual)
    for part in filter(None, map(str.strip, text.split(","))):
        key, equals, value = map(str.strip, part.partition("="))
        known = [*parameters, *_TIMES]
        if key not in known or not equals:
            raise InputError(f"{shown(part)} isn't KEY=VALUE; a {cls.kind} has {listed(known)}{meant(key, known)}")
        given[key] = _value(key, value, parameters.get(key))
    lacking = [item.name for item in parameters.values() if item.is_required and item.name not in given]
    if lacking:
        raise InputError(f"a {cls.kind} needs {listed(lacking)}: {cls.kind}:CHANNEL:{lacking[0]}=...")
    return given


def _value(key: str, text: str, item: Parameter | None) -> Any:
    """Return what a parameter, or a time, is given as."""
    kind = float if item is None else item.value_type
    if kind is str:
        return text
    try:
        return _FLAGS[text] if kind is bool else kind(text)
    except (ValueError, KeyError):
        legal = {float: "a number", int: "a whole number", bool: "true or false"}[kind]
        raise InputError(f"{key} is {shown(text)}; it must be {legal}") from None
