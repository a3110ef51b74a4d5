"""What commands that break a flight do alike: which faults are meant, typed in place or of a scenario's trial."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import click

from gtmbench.errors import InputError

if TYPE_CHECKING:
    from gtmbench.faults.fault import Fault
    from gtmbench.study.fault_tables import FaultSpec


_Command = TypeVar("_Command", bound=Callable[..., Any])


def fault_options(about: str, *, required: bool = False) -> Callable[[_Command], _Command]:
    """Add ``--fault``, ``--onset`` and ``--trial`` to a command: faults typed in place, or a scenario's."""

    def added(command: _Command) -> _Command:
        given = click.option(
            "--fault",
            "given",
            multiple=True,
            required=required,
            metavar="KIND:CHANNEL[:KEY=VALUE,...]|SCENARIO.toml",
            help=f"{about} Repeat it for several, as bias:r:size=2; or a scenario, whose severities must be absolute.",
        )
        onset = click.option("--onset", type=float, metavar="SECONDS", help="When typed faults begin.")
        trial = click.option(
            "--trial",
            type=int,
            metavar="N",
            help="The number of a scenario's trial, from 1 on.  [default: the only one]",
        )
        return given(onset(trial(command)))

    return added


def is_typed(text: str) -> bool:
    """Whether a fault is typed in place, not a scenario's file or name."""
    return ":" in text and not text.lower().endswith(".toml")


@dataclass(frozen=True, kw_only=True)
class ChosenFaults:
    """The faults that were asked for."""

    faults: tuple[Fault, ...] = ()
    source: str = ""  # the scenario, or the faults as they were typed
    trial: int = 1  # which trial of the scenario; 1 of typed ones

    @property
    def text(self) -> str:
        """What it is, in a verdict."""
        return self.source if is_typed(self.source) else f"trial {self.trial} of {self.source}"


def trial_number(trial: int | None, trials: Sequence[FaultSpec], scenario: str) -> int:
    """Return which trial is meant, or list those that there are.

    Raises InputError where there is no such trial, or none is named of several.
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


def chosen_faults(given: Sequence[str], onset: float | None, trial: int | None) -> ChosenFaults:
    """Return the faults that are typed, or those of a scenario's trial; none where nothing is given.

    Raises InputError where it isn't said which trial, a severity is relative, a typed fault is none, or has no onset.
    """
    from gtmbench.faults.typed import fault

    typed = [text for text in given if is_typed(text)]
    if typed and len(typed) < len(given):
        raise InputError("--fault names a scenario beside typed faults; give one or the other")
    if trial is not None and (typed or not given):
        raise InputError("--trial is of --fault SCENARIO.toml; give both")
    if onset is not None and not typed:
        raise InputError("--onset is of typed faults, such as --fault bias:r:size=2; a scenario has its own")
    if not given:
        return ChosenFaults()
    if typed:
        return ChosenFaults(faults=tuple(fault(text, onset_s=onset) for text in typed), source=" + ".join(typed))
    trials = scenario_trials(given)
    number = trial_number(trial, trials, given[0])
    return ChosenFaults(
        faults=trials[number - 1].absolute(f"{given[0]}, trial {number}"), source=given[0], trial=number
    )


def scenario_trials(given: Sequence[str]) -> tuple[FaultSpec, ...]:
    """Return the trials of the scenario that ``--fault`` names; none of typed faults."""
    from gtmbench.study.scenario import load_faults

    if any(map(is_typed, given)):
        return ()
    if len(given) > 1:
        raise InputError(f"--fault names {len(given)} scenarios; give one, or faults such as bias:r:size=2")
    return load_faults(given[0])
