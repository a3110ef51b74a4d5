"""A check: what a baseline names is run and held against it; what that says as lines, JSON, and JUnit XML."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from gtmbench.check.baseline import Reference
from gtmbench.check.compare import Compared, Number, Pair, compare
from gtmbench.check.figures import FigureGroup, figures_of, log_groups
from gtmbench.checks import naming, printable
from gtmbench.detectors.bank.composed import AUTO
from gtmbench.detectors.protocol import Detector, Monitor
from gtmbench.files.plain import attributes, envelope, finite_or_none
from gtmbench.files.writing import atomic_write
from gtmbench.jobs.progress import Progress, silent
from gtmbench.report.tables.results import versions
from gtmbench.study.run import run_study


@dataclass(frozen=True, kw_only=True)
class Check:
    """A baseline, held against a run."""

    reference: Reference
    groups: tuple[FigureGroup, ...]  # what the run gave
    compared: tuple[Compared, ...]  # every figure beside the recorded one

    @property
    def regressions(self) -> list[Compared]:
        """The figures that are worse than allowed, the furthest beyond its tolerance first."""
        return sorted((figure for figure in self.compared if figure.regressed), key=lambda figure: -figure.excess)

    @property
    def better(self) -> list[Compared]:
        """The figures that are better than recorded by more than the tolerance."""
        return [figure for figure in self.compared if figure.better]


def run_reference(
    reference: Reference, *, detector: Detector | Monitor | None = None, progress: Progress = silent
) -> tuple[FigureGroup, ...]:
    """Run what a baseline names and return its figures; `detector`: what goes by the name that the baseline states."""
    watcher = reference.detector if detector is None else detector
    groups: list[FigureGroup] = []
    if reference.scenarios:
        watches = [] if watcher is None else [watcher]
        groups += figures_of(run_study(reference.scenarios, detectors=watches, seed=reference.seed, progress=progress))
    if reference.logs:
        how = {"history": reference.history, "aircraft_id": reference.aircraft_id, "mapping": reference.mapping}
        groups += log_groups(reference.logs, watcher or AUTO, progress, **how)
    return tuple(groups)


def check(reference: Reference, groups: Sequence[FigureGroup]) -> Check:
    """Hold the figures of a run against a baseline."""
    with naming(reference.path):
        compared = compare(reference.recorded, groups, reference.tolerances)
    return Check(reference=reference, groups=tuple(groups), compared=compared)


def regression_line(figure: Compared) -> str:
    """Write a regression: which figure, what it was, what it is, and what is allowed."""
    said = f" ({figure.remark})" if figure.remark and figure.rule.form == "flag" else ""
    return f"{figure.text}: was {shown(figure.was)}, is {shown(figure.now)}, allowed {_allowed(figure)}{said}"


def check_verdict(check: Check) -> str:
    """Say in a sentence whether a figure is worse than its baseline allows."""
    regressions, better, total = len(check.regressions), len(check.better), len(check.compared)
    worse = f"{regressions} of {total} figures are worse than" if regressions else "No figure is worse than"
    same = total - regressions - better
    return f"{worse} the baseline {check.reference.path.name} allows; {better} better, {same} within their tolerances."


def check_lines(check: Check) -> list[str]:
    """Return what a check says: the verdict, then the regressions, the worst of them on top."""
    command, advice = f"gtmbench check {check.reference.path} --update", []
    if check.regressions:
        advice = [f"if that is what the change is meant to do: {command}"]
    elif check.better:
        advice = [f"to hold what is better from now on: {command}"]
    return [
        check_verdict(check),
        *map(regression_line, check.regressions),
        *_better_lines(check.better),
        *(f"not as expected: {line}" for group in check.groups for line in _unexpected(group)),
        *advice,
    ]


def _unexpected(group: FigureGroup) -> list[str]:
    """Say where a trial goes otherwise than its scenario expects: told, but a check fails by its figures only."""
    return [f"{group.title}: {line}" for line in group.unexpected]


def changed_rows(pairs: Iterable[Pair]) -> list[list[str]]:
    """Return rows of what differs: figure, was, is, unit; of a list, where it differs most, and in how many."""
    rows = []
    for _, entries in groupby(pairs, lambda pair: (pair.group, pair.figure)):
        several = list(entries)
        changed = [pair for pair in several if pair.changed]
        if changed:
            most = max(changed, key=_difference)
            count = f" ({len(changed)} of {len(several)} changed)" if len(several) > 1 else ""
            rows.append([f"{most.text}{count}", shown(most.was), shown(most.now), most.unit])
    return rows


def shown(value: Number | None) -> str:
    """Write a figure: yes or no, five digits, or - where there is none."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _allowed(figure: Compared) -> str:
    unit = f" {figure.unit}" if figure.unit else ""
    if figure.rule.form == "flag":
        return shown(figure.was)
    if math.isinf(figure.low):
        return f"up to {shown(figure.high)}{unit}"
    lowest = shown(figure.low)
    return f"down to {lowest}{unit}" if math.isinf(figure.high) else f"{lowest} to {shown(figure.high)}{unit}"


def _better_lines(better: list[Compared]) -> list[str]:
    """Return a line a group: ``better: drift of p: delay, peak ratio``."""
    lines = []
    for group, entries in groupby(better, lambda figure: figure.group):
        often = Counter(figure.rule.text for figure in entries)
        figures = ", ".join(text if count == 1 else f"{text} ({count} times)" for text, count in often.items())
        lines.append(f"better: {group}: {figures}")
    return lines


def _difference(pair: Pair) -> float:
    difference = math.inf if pair.was is None or pair.now is None else abs(pair.now - pair.was)
    return math.inf if math.isnan(difference) else difference


def check_results(check: Check) -> dict[str, Any]:
    """Return a check as one JSON-ready object: every figure, those that are worse as findings, the better beside."""
    own = {
        **_origin(check.reference),
        "passed": not check.regressions,
        "better": list(map(_compared_row, check.better)),
        "figures": list(map(_compared_row, check.compared)),
        "unexpected": [line for group in check.groups for line in _unexpected(group)],
        "versions": versions(),
    }
    worse = [{"text": regression_line(figure), **_compared_row(figure)} for figure in check.regressions]
    return envelope("check", check_verdict(check), own, exit_code=int(bool(worse)), findings=worse)


def update_verdict(reference: Reference, pairs: Sequence[Pair]) -> str:
    """Say in a sentence how many figures a new baseline changes."""
    path, total = reference.path, len(pairs)
    if not reference.recorded:
        return f"Recorded {total} figures in {path}; commit it, and run: gtmbench check {path}"
    changed = sum(pair.changed for pair in pairs)
    return f"{changed or 'None'} of {total} figures in {path} {'change' if changed > 1 else 'changes'}."


def update_results(reference: Reference, pairs: Sequence[Pair]) -> dict[str, Any]:
    """Return what a new baseline changes as one JSON-ready object; None: there is no such figure."""
    changed = [
        {"text": f"{pair.text}: was {shown(pair.was)}, is {shown(pair.now)}", **_pair_row(pair)}
        for pair in pairs
        if pair.changed
    ]
    own = {**_origin(reference), "versions": versions()}
    return envelope("check-update", update_verdict(reference, pairs), own, findings=changed)


def _origin(reference: Reference) -> dict[str, Any]:
    return {
        "baseline": str(reference.path),
        "scenarios": [scenario.name for scenario in reference.scenarios],
        "logs": list(reference.logs),
        **attributes(reference, "seed", "detector"),
    }


def _compared_row(figure: Compared) -> dict[str, Any]:
    allowed = {"allowed_from": finite_or_none(figure.low), "allowed_to": finite_or_none(figure.high)}
    return {**_pair_row(figure), **allowed, "remark": figure.remark}


def _pair_row(pair: Pair) -> dict[str, Any]:
    return {
        **attributes(pair, "group", "figure", "at"),
        "was": finite_or_none(pair.was),
        "is": finite_or_none(pair.now),
        "unit": pair.unit,
    }


def write_junit(check: Check, path: Path, *, took_s: float) -> None:
    """Write a check as a JUnit file; `took_s`: how long the run took."""
    failed: dict[str, list[str]] = {}
    for figure in check.regressions:
        failed.setdefault(figure.group, []).append(regression_line(figure))
    name = f"gtmbench check {check.reference.path.stem}"
    counts = {"tests": str(len(check.groups)), "failures": str(len(failed)), "errors": "0", "time": f"{took_s:.3f}"}
    suites = ET.Element("testsuites", {"name": "gtmbench check", **counts})
    suite = ET.SubElement(suites, "testsuite", {"name": printable(name), "skipped": "0", **counts})
    for group in check.groups:  # names without what XML can't hold: a file's may have control characters
        names = {"classname": printable(f"gtmbench.check.{check.reference.path.stem}"), "name": printable(group.title)}
        case = ET.SubElement(suite, "testcase", {**names, "time": "0"})
        lines = [printable(line) for line in failed.get(group.title, [])]
        if lines:
            ET.SubElement(case, "failure", {"message": lines[0], "type": "regression"}).text = "\n".join(lines)
        if group.unexpected:
            said = [f"not as expected: {line}" for line in group.unexpected]
            ET.SubElement(case, "system-out").text = "\n".join(map(printable, said))
    ET.indent(suites)
    suites.tail = "\n"
    with atomic_write(path) as aside:
        ET.ElementTree(suites).write(aside, encoding="utf-8", xml_declaration=True)
