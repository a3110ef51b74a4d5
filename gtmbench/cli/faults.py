"""What commands that break a flight do alike: which trial of a scenario is meant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from gtmbench.errors import InputError

if TYPE_CHECKING:
    from gtmbench.faults.fault import Fault
    from gtmbench.study.fault_tables import FaultSpec


trial_option = click.option(
    "--trial", type=int, metavar="N", help="The number of the trial, from 1 on.  [default: the only one]"
)


def trial_number(trial: int | None, trials: Sequence[FaultSpec], scenario: str) -> int:
    """Return which trial is meant, or list those that there are.

    Raises
    ------
    InputError
        Where there is no such trial, or none is named of several.
    """
    if trial is None and len(trials) == 1:
        return 1
    if trial is not None and 1 <= trial <= len(trials):
        return trial
    shown = "; ".join(numbered(trials)[:20]) + (" ..." if len(trials) > 20 else "")
    given = f"there is no trial {trial} of" if trial is not None else "--trial is missing, and there are several of"
    raise InputError(f"{given} {scenario}: {shown}")


def numbered(trials: Sequence[FaultSpec]) -> list[str]:
    """Return the trials of a scenario, a line each: ``1 jam of p, from 300 s``."""
    return [f"{number} {trial.text}" for number, trial in enumerate(trials, 1)]


def trial_faults(scenario: str | None, trial: int | None) -> tuple[Fault, ...]:
    """Return the faults of a trial, all severities absolute; none where no scenario is given.

    Raises
    ------
    InputError
        Where it isn't said which trial, or a severity is relative.
    """
    from gtmbench.study.scenario import load_faults

    if scenario is None:
        if trial is not None:
            raise InputError("--trial is of --fault SCENARIO.toml; give both")
        return ()
    trials = load_faults(scenario)
    number = trial_number(trial, trials, scenario)
    return trials[number - 1].absolute(f"{scenario}, trial {number}")
