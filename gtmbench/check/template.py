"""A new baseline of ``gtmbench check``: its settings and tolerances, commented, without figures yet."""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Sequence
from pathlib import Path

from gtmbench.check.rules import OF_LOGS, RULES
from gtmbench.checks import printable
from gtmbench.files.shipped import shipped_scenarios
from gtmbench.study.scenario import load_scenario

TOLERATED = tuple(name for name, rule in RULES.items() if rule.form != "flag")
_HEAD = """\
# A baseline of `gtmbench check`: what is run, how much worse a figure may get, and the figures of a run that was good.
# Edit what stands above [recorded]; `gtmbench check {name} --update` writes what stands below, and keeps comments.

# names of `gtmbench list`, or files, found from this one's folder
scenarios = [{scenarios}]
# of excitation and noise
seed = {seed}
# a monitor's file of `gtmbench calibrate`, or a detector, calibrated in every run; without: [operator] and [alarm]
{detector}

[tolerances]  # a share of the figure, a number in its unit, or the larger of both; better is never too much
{tolerances}
"""


_HEAD_OF_LOGS = """\
# A baseline of `gtmbench check`: the verdict on every sensor of some recorded flights, and how much worse it may get.
# Edit what stands above [recorded]; `gtmbench check {name} --update` writes what stands below, and keeps comments.

# folders, files or patterns, found from this one's folder; a new flight is recorded by --update
logs = [{logs}]
# how columns are read that don't say it themselves, as --map of `gtmbench monitor` takes it
map = []
# who watches: a name of `gtmbench list`, or a monitor's file of `gtmbench calibrate`
detector = {detector}

[tolerances]  # a share of the figure, a number in its unit, or the larger of both; better is never too much
{tolerances}
"""


def new_baseline(
    path: Path, *, scenarios: Sequence[str] = (), logs: Sequence[str] = (), detector: str | None = None
) -> str:
    """Return the text of a baseline without figures.

    `path`: where it will stand: its files are named from there. `scenarios`: shipped names, or files. `logs`: instead
    of scenarios: recorded flights, folders of them, or patterns. `detector`: a name of `gtmbench list`, a bank's or a
    monitor's file, or the own name of a detector in Python.
    """
    if logs:
        seen = ", ".join(quoted(_seen_from(path, source, ())) for source in logs)
        by = "auto" if detector is None else _detector_from(path, detector)
        stated = _stated([figure for figure in TOLERATED if figure in OF_LOGS])
        return _HEAD_OF_LOGS.format(name=printable(path.name), logs=seen, detector=quoted(by), tolerances=stated)
    strange = ("thresholds", "isolation_delay_s") if detector is None else ("threshold",)
    return _HEAD.format(
        name=printable(path.name),
        scenarios=", ".join(quoted(_seen_from(path, name, shipped_scenarios())) for name in scenarios),
        seed=load_scenario(scenarios[0]).setup.seed,
        detector='# detector = "monitor.json"'
        if detector is None
        else f"detector = {quoted(_detector_from(path, detector))}",
        tolerances=_stated([figure for figure in TOLERATED if figure not in (*strange, *OF_LOGS)]),
    )


def _stated(figures: Sequence[str]) -> str:
    """Return tolerances as a baseline states them, a line each with what it is of."""
    lines = [f"{figure} = {json.dumps(RULES[figure].tolerance)}" for figure in figures]
    width = max(map(len, lines))
    return "\n".join(f"{line:<{width}}  # {RULES[figure].meaning}" for line, figure in zip(lines, figures, strict=True))


def _detector_from(path: Path, detector: str) -> str:
    return _seen_from(path, detector, () if is_file_of_detector(detector) else (detector,))


def is_file_of_detector(name: str) -> bool:
    """Whether a bank's or a monitor's file is meant, not a name."""
    return Path(name).suffix.lower() in (".toml", ".json")


def quoted(given: str) -> str:
    """Return a text as TOML has it."""
    # DEL is the one that TOML escapes and JSON doesn't
    return json.dumps(given, ensure_ascii=False).replace("\x7f", "\\u007f")


def _seen_from(path: Path, name: str, shipped: Collection[str]) -> str:
    """Return a shipped name, or a file's path from the folder of a baseline."""
    return name if name in shipped else Path(os.path.relpath(Path(name), path.absolute().parent)).as_posix()
