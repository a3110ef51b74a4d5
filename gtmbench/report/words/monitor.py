"""A monitor in words and figures: what it is, stands on and tells apart, what its false-alarm rate is worth."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, TypeGuard

from gtmbench.checks import listed
from gtmbench.detectors.bank.detectability import (
    BY_SHAPE,
    NOT_TOLD,
    Isolability,
    isolability,
    slowest_drift,
    tolerated_shift,
)
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.detectors.protocol import Detector, Monitor, Watch, is_ready
from gtmbench.detectors.statistics.thresholds import Luck
from gtmbench.detectors.surfaces.equations import OWN_SURFACES, STEP_PERCENT, THROTTLE, Flow
from gtmbench.detectors.surfaces.surfaces import SurfaceMonitor
from gtmbench.detectors.tables import OPERATOR_KEYS
from gtmbench.detectors.windowed_norm import NormMonitor
from gtmbench.files.plain import attributes, exact, finite_or_none
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS
from gtmbench.report.words.units import counted, duration_text, first_few, or_dash, two_digits
from gtmbench.values.channels import COMMANDS, GYROS, SURFACES, unit_of

_OPERATOR = ("name", "condition", *(key for key in OPERATOR_KEYS if key != "markov"))


def facts(monitor: Monitor | Detector) -> dict[str, Any]:
    """Return a monitor's facts as one JSON-ready object; of a detector that wasn't calibrated its name and channels."""
    if not is_ready(monitor):
        return {"name": monitor.name, "channels": list(monitor.channels)}
    known: dict[str, Any] = {
        **exact(attributes(monitor, "name", "channels", "suspects", "sample_period_s", "look_ahead_s")),
        "provenance": dict(monitor.provenance),
    }
    if isinstance(monitor, NormMonitor):
        known |= norm_facts(monitor)
    if isinstance(monitor, BankMonitor):
        known |= {
            "bank": monitor.bank.name,
            "title": monitor.bank.title,
            "told_apart": isolability(monitor.bank).table(),
            "residuals": {output: _residual(monitor, output) for output in monitor.operators},
        }
    return known


def norm_facts(monitor: NormMonitor) -> dict[str, Any]:
    """Return the operator, the threshold of E(k) and the length of its window."""
    return {
        "operator": exact(attributes(monitor.operator, *_OPERATOR)),
        "threshold": monitor.threshold,
        "threshold_unit": unit_of(monitor.operator.outputs[0]),
        "window_s": monitor.window_s,
    }


def bank_summary(monitor: BankMonitor) -> dict[str, Any]:
    """Say what a bank is: its residuals with what they look back on and ahead, where it comes from."""
    return {
        "bank": monitor.bank.name,
        "title": monitor.bank.title,
        "statistic": monitor.bank.statistic.name,
        "suspects": list(monitor.bank.suspects),
        "residuals": [
            {
                "output": spec.output,
                "inputs": list(spec.inputs),
                "look_ahead_s": monitor.look_ahead_of(spec.output),
                "history_s": monitor.history_of(spec.output),
            }
            for spec in monitor.bank.residuals
        ],
        "thresholds": sum(len(of) for of in monitor.thresholds.values()),
        "sample_period_s": monitor.sample_period_s,
        "provenance": dict(monitor.provenance),
    }


def rms_identified(monitor: Monitor | Detector) -> dict[str, float]:
    """Return the RMS of every residual where its operator was identified, by output; empty where that isn't known."""
    if isinstance(monitor, NormMonitor):
        return dict(zip(monitor.operator.outputs, monitor.operator.rms_residual.tolist(), strict=True))
    if isinstance(monitor, BankMonitor):
        return {output: float(operator.rms_residual[0]) for output, operator in monitor.operators.items()}
    return {}


def monitor_lines(monitor: Monitor, watch: Watch) -> list[str]:
    """Say what a monitor is, and its thresholds, as far as its watch of a healthy record shows them."""
    if isinstance(monitor, BankMonitor):
        return [_bank_line(monitor)]
    armed_s = min((score.armed_s for score in watch.scores.values() if score.armed_s is not None), default=None)
    armed = "never armed" if armed_s is None else f"armed at {armed_s:g} s"
    thresholds = [f"{score.name} {score.threshold:.4g} {score.unit}".rstrip() for score in watch.scores.values()]
    if isinstance(monitor, NormMonitor):
        when = "" if armed_s is None else ", when E(k) first was at or below it"
        threshold = f"{monitor.threshold:.4g} {unit_of(monitor.operator.outputs[0])}".rstrip()
        waits = f"look-ahead {monitor.look_ahead_s:g} s, window {monitor.window_s:g} s"
        return [f"threshold: {threshold}; {armed}{when}", f"times of alarms include {waits}"]
    known = f"thresholds: {', '.join(thresholds)}; {armed}" if thresholds else "it shows no score"
    return [f"monitor: {monitor.name}; {known}; delays count look-ahead ({monitor.look_ahead_s:g} s)"]


def _bank_line(monitor: BankMonitor) -> str:
    ahead = sorted((monitor.look_ahead_of(spec.output), spec.output) for spec in monitor.bank.residuals)
    looks = ", ".join(
        f"{'/'.join(output for _, output in group)} {look_s:g} s"
        for look_s, group in groupby(ahead, lambda pair: pair[0])
    )
    count = counted(sum(len(of) for of in monitor.thresholds.values()), "threshold")
    hours = monitor.provenance.get("threshold_hours")
    stand = f", set on {hours:.2f} h of healthy flight" if isinstance(hours, float) else ""
    return f"monitor: bank {monitor.bank.name}; {count}{stand}; delays count look-ahead ({looks})"


def _residual(monitor: BankMonitor, output: str) -> dict[str, Any]:
    operator, tolerance = monitor.operators[output], monitor.tolerances[output]
    return {
        "inputs": list(operator.inputs),
        "unit": PSEUDO_INPUTS[output].unit if output in PSEUDO_INPUTS else unit_of(output),
        "rms_residual": float(operator.rms_residual[0]),
        "look_ahead_s": monitor.look_ahead_of(output),
        "tolerated_shift": finite_or_none(tolerated_shift(monitor, output)),
        "tolerated_energy": [tolerance.low, tolerance.high],
        "slowest_drift_per_s": finite_or_none(slowest_drift(monitor, output)),
    }


def residual_rows(monitor: BankMonitor) -> tuple[list[str], list[list[str]], list[str]]:
    """Return a table of the residuals: its columns, rows, and the columns to align to the right."""
    columns = ["residual", "unit", "RMS", "ahead (s)", "shift", "energy", "drift per s", "predicted from"]
    rows = []
    for output in monitor.operators:
        residual = _residual(monitor, output)
        rows.append(
            [
                output,
                residual["unit"],
                f"{residual['rms_residual']:.3g}",
                f"{residual['look_ahead_s']:g}",
                or_dash(residual["tolerated_shift"], ".2g"),
                "{:.2f}..{:.2f}".format(*residual["tolerated_energy"]),
                or_dash(residual["slowest_drift_per_s"], ".2g"),
                " ".join(residual["inputs"]),
            ]
        )
    return columns, rows, columns[2:-1]


def facts_text(monitor: BankMonitor) -> list[str]:
    """Return what a monitor stands on, line by line; a line is left out where the monitor doesn't know."""
    return [
        "shift, energy: how far a healthy residual's mean and mean square (1: noise) may move; drift: slower ones "
        "are not detected",
        *origin_text(monitor),
    ]


def origin_text(monitor: Monitor) -> list[str]:
    """Return what a monitor was calibrated on, and what its false-alarm rate is worth, as far as it knows."""
    known: Mapping[str, Any] = monitor.provenance
    lines = [f"calibrated on: {_origin(known)}"] if known or isinstance(monitor, BankMonitor) else []
    if "tolerated_imperfections" in known:
        lines.append(f"imperfections of healthy gyros: {known['tolerated_imperfections']}")
    lines += map(str, known.get("left_out", ()))
    hours: list[Any] = [known.get(key) for key in ("identification_hours", "threshold_hours")]
    if all(_is_number(value) for value in hours):
        lines.append(f"identified on {duration_text(hours[0])}, {_thresholds_from(monitor, hours[1])}")
    wanted, bound = known.get("false_alarms_per_hour"), known.get("false_alarms_per_hour_at_most")
    if _is_number(wanted) and _is_number(bound) and _is_number(hours[1]):
        watched = duration_text(hours[1])
        lines.append(
            f"false alarms: {wanted:g} an hour asked for, which extrapolates the tails; the {watched} that set the "
            f"thresholds show no more than {two_digits(bound)} an hour (95 %)"
        )
    luck = Luck.from_provenance(known)
    if luck is not None:
        lines.append(
            f"luck of these records: others like them would move thresholds by a factor of {luck.median:.2g} "
            f"(median), {luck.within:.2g} (95 %)"
        )
    return lines


def _thresholds_from(monitor: Monitor, hours: Any) -> str:
    if isinstance(monitor, BankMonitor) and monitor.uncertainties:
        return "thresholds from the same, each stretch tested by operators that were not fitted on it"
    return f"thresholds from {duration_text(hours)} of other records"


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _origin(known: Mapping[str, Any]) -> str:
    """Say where the records come from; a file may hold anything there."""
    count, source = known.get("records", "?"), known.get("source")
    seeds, logs = known.get("seeds"), known.get("logs")
    if source == "flights" and isinstance(seeds, list) and len(seeds) == 2 and _is_number(known.get("duration_s")):
        return (
            f"{count} flights of {known.get('aircraft')}, {known['duration_s']:g} s each, {known.get('excitation')}, "
            f"noise {known.get('noise')}, seeds {seeds[0]} to {seeds[1]}"
            + (f", {known['in_the_loop']} in the loop" if "in_the_loop" in known else "")
        )
    if source == "logs" and isinstance(logs, list) and all(isinstance(log, dict) for log in logs):
        return first_few([str(log.get("name")) for log in logs], 5)
    return f"{count} records"


def isolation_lines(told: Isolability) -> list[str]:
    """Say which residuals a fault of each suspect raises, and what isn't told by that."""
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, outputs in told.enters.items():
        groups.setdefault(outputs, []).append(name)
    lines = []
    if len(groups) > 1:
        said = (f"{listed(names)} ({listed(outputs)})" for outputs, names in groups.items())
        lines.append(f"isolable by which residuals rise: {', '.join(said)}")
    if alike := "; ".join(_by_shape(told)):
        lines.append(f"isolable only by how they rise: {alike}")
    if mistaken := "; ".join(_indistinguishable(told)):
        unknown = listed([name for name in told.suspects if name not in told.predicted])
        lines.append(f"not isolable: {mistaken}, because nothing predicts {unknown}")
    return lines


def _by_shape(told: Isolability) -> Iterator[str]:
    """Say who is told from whom only by how residuals rise: from those whose faults raise more, and from the like."""
    like, more = defaultdict(list), defaultdict(list)
    for one in told.suspects:
        others = [other for other in told.suspects if other != one and told.told(one, other) == BY_SHAPE]
        alike = {other for other in others if told.enters[other] == told.enters[one]}
        if alike:
            like[told.enters[one]].append(one)
        if wider := tuple(other for other in others if other not in alike):
            more[wider].append(one)
    yield from (f"{listed(ones)} from {listed(others)}" for others, ones in more.items())
    yield from (f"{listed(names)} from each other" for names in like.values())


def _indistinguishable(told: Isolability) -> Iterator[str]:
    """Say whose fault can't be told from that of a suspect which nothing predicts."""
    unknown = [name for name in told.suspects if name not in told.predicted]
    mistaken, mixed = defaultdict(list), []
    for one in unknown:
        ways = {other: (told.told(one, other), told.told(other, one)) for other in told.suspects if other != one}
        others = [other for other, both in ways.items() if NOT_TOLD in both]
        if known := tuple(name for name in others if name in told.predicted):
            mistaken[known].append(one)
        if len(known) < len(others):
            mixed.append(one)
    yield from (f"{listed(known)} from {listed(ones)}" for known, ones in mistaken.items())
    if mixed:
        yield f"{listed(mixed)} from each other"


EQUATIONS = ("equation", "surfaces in it", "beside them")
_BESIDE = {
    "lateral": "sideslip, roll and yaw rate, inertia",
    "longitudinal": "angle of attack, pitch rate, inertia",
    "forward": "angle of attack, sideslip, pitch rate",
}


def equation_rows(flow: Flow, judged: Sequence[str] | None = None) -> list[list[str]]:
    """Return a row an equation: what it explains, which surfaces are in it, and what else.

    `judged`: the surfaces that are; by default all that could be.

    >>> equation_rows(Flow(forward=True))[1]
    ['change of q', 'elevator throttle', 'angle of attack, pitch rate, inertia']
    >>> equation_rows(Flow())[1]
    ['change of q', 'elevator', 'angle of attack, pitch rate, inertia, thrust']
    """
    judged = judged or (COMMANDS if flow.forward else SURFACES)
    rows = []
    for name, axis in flow.equations(judged).items():
        own = [surface for surface in OWN_SURFACES[axis] if surface in judged]
        thrust = ", thrust" if THROTTLE in OWN_SURFACES[axis] and THROTTLE not in judged else ""
        rows.append([f"change of {name}" if name in GYROS else name, " ".join(own), _BESIDE[axis] + thrust])
    return rows


def effect_rows(monitor: SurfaceMonitor) -> tuple[list[str], list[list[str]]]:
    """Return columns and rows: what a degree (20 %) of each surface changes, and what gusts amount to in these."""
    surfaces, steps = list(monitor.suspects), monitor.answer.frame.steps
    rows = [
        [
            f"{name} ({'deg/s²' if name in GYROS else unit_of(name)})",
            *(f"{value:.3g}" if value else "" for value in effects),
        ]
        for name, effects in zip(monitor.answer.frame.equations, monitor.answer.effects, strict=True)
    ]
    noise = monitor.normal.noise[: len(surfaces)] * steps
    rows.append(["gusts and sensors (deg, %)", *(f"{value:.2g}" for value in noise)])
    headed = [f"{name} ({STEP_PERCENT:g} %)" if name == THROTTLE else name for name in surfaces]
    return ["equation", *headed], rows
