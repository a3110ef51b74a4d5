"""Faults, alarms and judgements in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from gtmbench.detectors.alarm import MISSING, OUTSIDE, Alarm, Judgement
from gtmbench.detectors.isolation.fitter import UNKNOWN
from gtmbench.detectors.protocol import Watch
from gtmbench.faults.fault import Fault
from gtmbench.faults.parameter import Parameter
from gtmbench.faults.registry import loaded_faults
from gtmbench.report.words.units import per_second, percent_text, with_interval
from gtmbench.values.channels import unit_of
from gtmbench.values.record import Span

if TYPE_CHECKING:
    from gtmbench.study.trial import InjectedFaults

_ONSET, _CLOSE_S = "onset_s", 0.1  # an interval that short isn't told
_BEFORE = {_ONSET: "from ", "value": "at "}


def fault_text(fault: Fault) -> str:
    """Name a fault with its channel, other ones that it reads, and its severity.

    >>> from gtmbench.faults.kinds.additive import Drift
    >>> from gtmbench.faults.kinds.replacing import Swap
    >>> fault_text(Drift(channel="p", onset_s=300, slope=0.05)), fault_text(Swap(channel="p", onset_s=300, other="q"))
    ('drift of p, 0.05 deg/s²', 'swap of p with q')
    """
    others = [_beside(fault.kind, other) for other in fault.reads[1:]]
    what = " ".join([fault.kind.replace("_", " "), "of", fault.channel, *others])
    return ", ".join(part for part in (what, severity_text(fault)) if part)


def _beside(kind: str, other: str) -> str:
    """Name the other channel of a kind that mixes two."""
    cls = loaded_faults().get(kind, Fault)
    return f"{cls.beside} {other}"


def severity_text(fault: Fault) -> str:
    """Write a fault's severity with its unit: ``0.05 deg/s²``; empty for a fault without one."""
    values, of = fault.severities, units_of(fault)
    return ", ".join(f"{value:.3g} {of[name]}".rstrip() for name, value in values.items())


def units_of(fault: Fault) -> dict[str, str]:
    """Return the units of a fault's severities by name."""
    unit = unit_of(fault.channel)
    return {item.name: parameter_unit(item, unit) for item in fault.parameters() if item.is_severity}


def parameter_unit(item: Parameter, unit: str) -> str:
    """Return a parameter's unit, the channel's being `unit`."""
    if item.unit is not None:
        return item.unit
    return per_second(unit) if item.per_second else f"{unit}/{item.per}" if item.per else unit


def trial_label(trial: InjectedFaults) -> str:
    """Name a trial among those of its scenario: ``q, 0.05 deg/s²``."""
    severity = severity_text(trial.injected)
    return f"{trial.channel}, {severity}" if severity else trial.channel


def trial_text(trial: InjectedFaults) -> str:
    """Name a trial by all that breaks in it: ``drift of q, 0.05 deg/s² + jam of r``."""
    return " + ".join(map(fault_text, (trial.injected, *trial.also)))


def repetitions(trials: Sequence[InjectedFaults]) -> list[int]:
    """Return for every trial of a detector how many before it broke the same channel in the same scenario."""
    often = Counter[tuple[str, str]]()
    counts = []
    for trial in trials:
        counts.append(often[trial.scenario, trial.channel])
        often[trial.scenario, trial.channel] += 1
    return counts


def parameter_units(kind: str, names: Iterable[str], unit: str, injected: Fault | None = None) -> dict[str, str]:
    """Return the units of a kind's parameters as a diagnosis names them, the channel's being `unit`.

    A constant reading has the channel's. Of a kind that only the `injected` fault knows, its declaration tells.
    """
    known = injected if injected is not None and injected.kind == kind else loaded_faults().get(kind)
    units = {item.name: parameter_unit(item, unit) for item in known.parameters()} if known else {}
    return {name: units.get(name, "s" if name.endswith("_s") else unit if known else "") for name in names}


def estimate_text(
    kind: str, parameters: Mapping[str, float], intervals: Mapping[str, Span], unit: str, injected: Fault | None = None
) -> str:
    """Write the parameters of a kind of fault with the intervals that hold them at 95 %, and units."""
    units = parameter_units(kind, parameters, unit, injected)
    return ", ".join(
        f"{_BEFORE.get(name, '')}{_figure(name, value, intervals.get(name))} {units[name]}".rstrip()
        for name, value in parameters.items()
    )


def _figure(name: str, value: float, interval: Span | None) -> str:
    """Write a value with its interval; a time of the record that is known closely to hundredths, as all times are."""
    is_close = interval is None or interval[1] - interval[0] < _CLOSE_S
    return f"{value:.2f}" if name == _ONSET and is_close else with_interval(value, interval)


def kind_text(
    kind: str,
    parameters: Mapping[str, float],
    intervals: Mapping[str, Span],
    unit: str,
    partner: str | None = None,
    injected: Fault | None = None,
) -> str:
    """Say what kind of fault: with its parameters, and the other sensor of one that mixes two.

    >>> kind_text("misalignment", {"angle_deg": 5.0}, {"angle_deg": (4.9, 5.1)}, "deg/s", "q")
    'misalignment 5.0 ± 0.1 deg towards q'
    >>> kind_text("swap", {}, {}, "deg/s", "q"), kind_text("unknown", {}, {}, "deg/s")
    ('swap with q', 'unknown kind')
    """
    if kind == UNKNOWN:
        return "unknown kind"
    other = "" if partner is None else _beside(kind, partner)
    estimate = estimate_text(kind, parameters, intervals, unit, injected)
    return " ".join(part for part in (kind.replace("_", " "), estimate, other) if part)


def judgement_text(judged: Judgement) -> str:
    """Say what a judgement says: who, or between whom it is and why, what kind of fault and how large, and how sure.

    >>> judgement_text(Judgement(time_s=9.0, sensor="p", candidates=("p",), kind="swap", partner="q", probability=0.97))
    'p and q have changed places (sensor 97 %)'
    """
    who = judged.verdict + (f" - {judged.reason}" if judged.reason else "")
    if judged.together:
        each = [f"{one.candidates[0]}: {_kind_of(one)}{_sure(one)}" for one in judged.together if one.candidates]
        return "; ".join([who, *each]) + _sure(judged)
    if judged.kind is None or judged.swapped:
        return who + _sure(judged)
    kind = _kind_of(judged)
    told = f"{who}; {kind}" if judged.sensor is not None else f"{who}; if {judged.candidates[0]}, {kind}"
    return told + _sure(judged)


def _kind_of(judged: Judgement) -> str:
    likeliest = judged.candidates[0] if judged.candidates else ""
    return kind_text(judged.kind or UNKNOWN, judged.parameters, judged.intervals, unit_of(likeliest), judged.partner)


def _sure(judged: Judgement) -> str:
    known = {"sensor": judged.probability, "kind": judged.kind_probability}
    shares = [f"{name} {percent_text(chance)}" for name, chance in known.items() if chance is not None]
    return f" ({', '.join(shares)})" if shares else ""


def alarm_text(alarm: Alarm) -> str:
    """Say what is known of an alarm at the end: as its last judgement does, or that it is one."""
    return "alarm" if alarm.last is None else judgement_text(alarm.last)


def source_text(alarm: Alarm, watch: Watch) -> str:
    """Say what rose: ``residual of p (mean 0.16 s)``, ``missing samples of p``; "" of a detector with one score."""
    if len(watch.scores) < 2 and not alarm.test:
        return ""
    if alarm.test == MISSING:
        return f"missing samples of {alarm.source}"
    source = f"residual of {alarm.source}" if alarm.source in watch.residuals else alarm.source
    if alarm.test == OUTSIDE:
        return f"{source} (not judged there)"
    return f"{source} ({alarm.test})" if alarm.test else source


def whole_text(alarm: Alarm) -> str:
    """Say what rose over the whole log."""
    return f"{alarm.source} less the attitude's rate, over the whole log"
