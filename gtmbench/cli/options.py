"""Options that commands share: detectors, faults, logs and their columns, what a verdict speaks for, clusters."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from gtmbench.checks import whole
from gtmbench.cli.output import PATH, F
from gtmbench.errors import InputError
from gtmbench.files.writing import LOGS, is_file, no_such

if TYPE_CHECKING:
    from gtmbench.faults.fault import Fault
    from gtmbench.study.fault_tables import FaultSpec
    from gtmbench.values.record import Span

_DASHED = re.compile(r"\s*(\d+\.?\d*) *s? *(?:-|\.\.|,|to|:) *(\d+\.?\d*) *s?\s*")  # how else people write a span
_METAVAR = "NAME|FILE.json|FILE.py:OBJECT|PACKAGE:OBJECT"
_HELP = (
    "The detector: a name from `gtmbench list`, a bank's .toml, a monitor's .json from `gtmbench calibrate`, or a "
    "Python object (a detector, a monitor, or a function from a record to the times of its alarms; with what `gtmbench "
    "calibrate` saved of it: FILE.py:OBJECT@FILE.json). Python is imported only if you name it here."
)


def refuse(options: Mapping[str, object], why: str) -> None:
    """Refuse options, by their names, as far as they are given where they say nothing."""
    for option, value in options.items():
        if value not in (None, False, (), ""):
            raise InputError(f"{option} is {why}")


def detector_option(text: str = "", *, multiple: bool = False) -> Callable[[F], F]:
    """Return the option ``--detector``."""
    name = "detectors" if multiple else "detector"
    help_text = f"{_HELP} {text}".strip() + (" Repeat it for several." if multiple else "")
    return click.option("--detector", name, multiple=multiple, metavar=_METAVAR, help=help_text)


def import_option(command: F) -> F:
    """Add ``--import``: packages or files that register faults of one's own."""

    def brought(context: click.Context, option: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
        context.meta[option.name or ""] = value  # no command takes it, and a page says how it was made
        if value:
            from gtmbench.faults.registry import import_package

            for source in value:
                import_package(source)
        return value

    return click.option(
        "--import",
        "imported",
        multiple=True,
        metavar="PACKAGE|FILE.py",
        expose_value=False,
        is_eager=True,
        callback=brought,
        help="Import this first, to register your own faults, for scenarios and for names in a verdict.",
    )(command)


def watchers_of(sources: Sequence[str]) -> list[Any]:
    """Return what a command's ``--detector``, given several times, names: the dissertation's stays a name."""
    from gtmbench.detectors.registry import find_detector

    return [source if source == "dissertation" else find_detector(source) for source in sources]


def rate_option(command: F) -> F:
    """Add ``--rate``: `rate_hz`."""
    told = "Resample to this rate in Hz.  [default: the slowest channel's, 100 at most]"
    return click.option("--rate", "rate_hz", type=float, help=told)(command)


def healthy_option(usual: str) -> Callable[[F], F]:
    """Return the option ``--healthy`` for a command that learns on a part of a log."""
    return click.option(
        "--healthy",
        multiple=True,
        metavar="T0:T1|LOG",
        help=f"What is known to be healthy, to learn from: a span of this log in seconds, or another log. {usual}",
    )


def healthy_part(text: str) -> Span | Path:
    """Return a span, open ends allowed (``:30``, ``40:``), or another log's path."""
    if is_file(Path(text)):
        return Path(text)
    asked = f"--healthy is '{text}', and there is no such log; give a span in seconds, such as 0:30, or another log"
    if Path(text).suffix.lower() in LOGS:
        raise InputError(f"--healthy: {no_such(Path(text))}")
    dashed = _DASHED.fullmatch(text)
    likely = ""
    if dashed and dashed[1] != dashed[2]:
        likely = "; did you mean {}:{}?".format(*sorted(dashed.groups(), key=float))
    start, _, end = map(str.strip, text.partition(":"))
    try:
        start_s, end_s = float(start or "-inf"), float(end or "inf")
    except ValueError:
        raise InputError(asked + likely) from None
    if ":" not in text:
        raise InputError(asked + (f"; did you mean 0:{start}?" if start_s > 0.0 else ""))
    if not start_s < end_s:  # so for NaN, too
        raise InputError(f"--healthy is '{text}'; the start must come before the end{likely}")
    return start_s, end_s


def fault_options(about: str, *, required: bool = False) -> Callable[[F], F]:
    """Add ``--fault``, ``--onset`` and ``--trial`` to a command: faults typed in place, or a scenario's."""

    def added(command: F) -> F:
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
    """Return which trial is meant, or list those that there are."""
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
    """Return the faults that are typed, or those of a scenario's trial; none where nothing is given."""
    from gtmbench.faults.registry import fault

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


def map_option(command: F) -> F:
    """Add ``--map`` and ``--units`` to a command that reads a log: its `mapping` holds both, of files what they say."""

    @wraps(command)
    def told(*arguments: Any, mapping: tuple[str, ...], units: str | None, **options: Any) -> Any:
        files = map_files(mapping)
        typed = [text for text in mapping if Path(text) not in files]
        own = {text.partition("=")[0].strip() for text in typed}
        kept = [text for file in files for text in _kept_mapping(file) if text.partition("=")[0] not in own]
        stated = () if units is None else (f"units={units}",)
        return command(*arguments, mapping=(*typed, *kept, *stated), **options)

    option = click.option(
        "--map",
        "mapping",
        multiple=True,
        metavar="CHANNEL=COLUMN:UNIT|FILE.toml",
        help="Map a column whose name doesn't identify it: p=gyro_x:rad/s, nz=-az:m/s2 (turns the sign), "
        "time=stamp:us, psi=yaw:deg@0.3 (stamped 0.3 s late). Or a file of these; `gtmbench monitor` writes it where "
        "there is none.",
    )
    unit = click.option(
        "--units",
        type=click.Choice(["rad", "deg"]),
        help="What angles, and rates per second, are in that state no unit.",
    )
    return cast(F, option(unit(told)))


def map_files(mapping: Sequence[str]) -> list[Path]:
    """Return the files among what ``--map`` was given."""
    return [Path(text) for text in mapping if "=" not in text and text.lower().endswith(".toml")]


def _kept_mapping(path: Path) -> list[str]:
    """Return what a file of maps holds; nothing of one that `gtmbench monitor` is to write."""
    if not path.exists() and click.get_current_context().command.name == "monitor":
        return []
    from gtmbench.intake.flight_log import read_map_file

    return read_map_file(path)


def attitude_option(command: F) -> F:
    """Add ``--attitude`` to a command that calibrates on logs."""
    return click.option(
        "--attitude",
        type=click.Choice(["auto", "own", "driven"]),
        default="auto",
        show_default=True,
        help="Whether an estimator computes the log's attitude from the gyros (driven) or it is independent (own). "
        "auto: as the format documents, otherwise as the samples show.",
    )(command)


def scope_options(command: F) -> F:
    """Add ``--judge`` and ``--limit`` to a command that gives a verdict on logs; limits are checked before any work."""

    @wraps(command)
    def told(*arguments: Any, limits: tuple[str, ...], **options: Any) -> Any:
        from gtmbench.verdict.scope import Scope

        Scope(sensors=()).with_limits(limits)
        return command(*arguments, limits=limits, **options)

    judge = click.option(
        "--judge",
        metavar="SENSORS",
        help="What the verdict speaks for: p,q,r or gyros, attitude, surfaces, all.  [default: gyros and attitude]",
    )
    limit = click.option(
        "--limit",
        "limits",
        multiple=True,
        metavar="SIZE",
        help="A fault that has to show for a sensor to be clear: 2deg/s of a gyro, 8deg of an angle, factor=0.7 of a "
        "gyro. Repeat it for several.  [default: 5deg/s, 10deg]",
    )
    return cast(F, judge(limit(told)))


def jobs_option(command: F) -> F:
    """Add ``--jobs``, all cores unless told."""

    def checked(_context: click.Context, _option: click.Parameter, value: int | None) -> int:
        return whole("--jobs", os.cpu_count() or 1 if value is None else value, 1, 1000)

    told = "Processes on this machine.  [default: all cores]"
    return click.option("--jobs", type=int, callback=checked, help=told)(command)


def cluster_options(command: F) -> F:
    """Add ``--scheduler`` and ``--tls``, which is refused alone."""

    @wraps(command)
    def told(*arguments: Any, scheduler: str | None, tls: Path | None, **options: Any) -> Any:
        if tls is not None and scheduler is None:
            raise InputError("--tls is for a --scheduler, and none is given")
        return command(*arguments, scheduler=scheduler, tls=tls, **options)

    tls = click.option(
        "--tls", type=PATH, metavar="FOLDER", help="With --scheduler: the folder of ca.pem, cert.pem and key.pem."
    )
    where = "Run the tasks on a Dask cluster: tcp://HOST:PORT, tls://..."
    return cast(F, click.option("--scheduler", metavar="ADDRESS", help=where)(tls(told)))
