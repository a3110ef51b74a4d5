"""``gtmbench calibrate``: a detector, learnt on healthy flights; ``gtmbench export``: what was learnt, as C."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import number
from gtmbench.cli.listing import print_bank_monitor
from gtmbench.cli.options import attitude_option, detector_option, healthy_option, healthy_part, map_option, refuse
from gtmbench.cli.output import (
    PATH,
    HeadedCommand,
    claim_file,
    claim_folder,
    common_options,
    echo,
    finish,
    say,
    shown_progress,
)
from gtmbench.errors import InputError
from gtmbench.files.plain import envelope
from gtmbench.jobs.progress import Progress
from gtmbench.report.words.units import counted

if TYPE_CHECKING:
    from gtmbench.bench.sensors import Imperfections
    from gtmbench.detectors.protocol import Detector, Monitor
    from gtmbench.method.driven_attitude import Origin
    from gtmbench.values.record import Record


@click.command("calibrate", cls=HeadedCommand)
@click.argument("logs", nargs=-1, metavar="[HEALTHY_LOG ...]", type=PATH)
@map_option
@detector_option("The default is bank C.")
@click.option("--out", default="monitor.json", show_default=True, type=PATH, help="The monitor's file.")
@healthy_option("Without it, all of every log. With it, one log is learnt as `gtmbench monitor` learns it.")
@click.option(
    "--inputs", metavar="p,q,beta", help="Instead of a detector: predict from these channels or pseudo inputs ..."
)
@click.option("--outputs", metavar="r", help="... predict these sensors.")
@click.option(
    "--look", default=0.5, show_default=True, help="With --inputs and --outputs: seconds to look back and ahead."
)
@click.option("--rate", "rate_hz", type=float, help="The monitor's rate in Hz.  [default: the first log's]")
@click.option(
    "--false-alarms-per-hour",
    "rate",
    type=float,
    help="False alarms per flight hour to calibrate the whole monitor for; a detector that can't promise a rate "
    "refuses it.  [default: 0.002 for a bank, 1 for --inputs and --outputs]",
)
@click.option("--flights", type=int, help="Without logs: the number of flights to fly.  [default: 60]")
@click.option("--duration", "duration_s", type=float, help="Without logs: seconds of each flight.  [default: 500]")
@click.option("--excitation", help="A name from `gtmbench list`, or a sum of names.  [default: multisine+turbulence]")
@click.option("--aircraft", help="A name from `gtmbench list --all`, or an aircraft's folder.  [default: gtm]")
@click.option(
    "--tolerate",
    metavar="TEXT",
    help="Imperfections of healthy gyros that must not alarm: bias=0.5,wander=0.002,lag=0.005,quantum=0.05.",
)
@click.option(
    "--sensors",
    metavar="ideal|chain",
    help="Without logs: chain flies on the aircraft's own sensor chain.  [default: ideal]",
)
@click.option("--seed", default=1, show_default=True, help="Seed of the first flight, its noise and imperfections.")
@attitude_option
@click.option("--force", is_flag=True, help="Write over an existing file.")
@common_options
def calibrate_command(
    logs: tuple[Path, ...],
    detector: str | None,
    out: Path,
    healthy: tuple[str, ...],
    inputs: str | None,
    outputs: str | None,
    look: float,
    rate: float | None,
    tolerate: str | None,
    seed: int,
    force: bool,
    mapping: tuple[str, ...],
    rate_hz: float | None,
    attitude: str,
    **of_flights: Any,
) -> None:
    """Learn a detector on healthy flights, and write the monitor that `gtmbench monitor --detector` takes.

    Example: gtmbench calibrate flight.csv --healthy 0:40 --out mine.json

    It reads logs as `gtmbench monitor` does. Without logs it flies (by default the GTM) with the T2's sensor noise.
    The file holds numbers and names only; any process or machine that loads it gives the same verdicts bit for bit.
    The output states how much other flights would change the thresholds; more than three times is refused.
    """
    from gtmbench.detectors.assumptions import basis_of
    from gtmbench.detectors.monitor_file import save_monitor
    from gtmbench.report.words.monitor import facts

    claim_file(out, force=force, ends=[".json"])
    rate = 1.0 if rate is None and inputs else rate  # its residual's energy is mostly the model's error
    rate = None if rate is None else number("--false-alarms-per-hour", rate, 1e-9, 1e3)
    recipe = _recipe(detector, inputs, outputs, look)
    given = {key: value for key, value in of_flights.items() if value is not None}
    of_logs = {"--healthy": healthy, "--rate": rate_hz, "--map": mapping, "--attitude": attitude != "auto"}
    if logs:
        typed = {f"--{key.removesuffix('_s')}": value for key, value in given.items()}
        refuse(typed, "about flights, and with logs none is flown; leave out one or the other")
    else:
        refuse(of_logs, "about logs, and none is given; name the logs, or leave it out")
    if logs and basis_of(recipe).is_whole:
        name = recipe.name
        raise InputError(f"'{name}' learns nothing of logs; type gtmbench monitor {logs[0]} --detector {name}")
    with shown_progress() as tell:
        how: dict[str, Any] = {"mapping": mapping, "rate_hz": rate_hz, "progress": tell}
        if healthy:
            if tolerate is not None:
                raise InputError("--tolerate is about whole logs and flights; leave out --healthy, or it")
            taught = _on_part(recipe, logs, healthy, false_alarms_per_hour=rate, attitude=attitude, **how)
        elif logs:
            taught = _on_logs(recipe, logs, attitude, rate, imperfections=_imperfections(tolerate), seed=seed, **how)
        else:
            taught = _on_flights(recipe, given, rate, tell, imperfections=_imperfections(tolerate), seed=seed)
        save_monitor(taught.monitor, out)
    bank = "bank " if getattr(taught.monitor, "bank", None) else ""
    verdict = f"Calibrated {bank}{taught.monitor.name} on {taught.what}: {out}."

    def rest() -> None:
        _print_calibrated(taught)
        echo(f"monitor: {out} ({out.stat().st_size / 1000.0:.0f} kB)")

    finish(envelope("calibrate", verdict, {"out": str(out), "monitor": facts(taught.monitor)}), rest)


@dataclass(frozen=True, kw_only=True)
class _Taught:
    """A monitor, what it was learnt on, the channels of that, and whose attitude that is."""

    monitor: Monitor
    what: str
    channels: tuple[str, ...] = ()
    attitude: Origin | None = None


def _recipe(detector: str | None, inputs: str | None, outputs: str | None, look: float) -> Detector:
    """Return what is to be learnt: a detector, or a bank between channels."""
    from gtmbench.detectors.bank_detector import BankDetector
    from gtmbench.detectors.protocol import is_recipe
    from gtmbench.detectors.registry import find_detector
    from gtmbench.log.watch import bank_between

    if inputs or outputs:
        if detector is not None:
            raise InputError("both --detector and --inputs/--outputs are given; a bank has its own, so leave one out")
        if not inputs or not outputs:
            missing = "--outputs" if inputs else "--inputs"
            raise InputError(
                f"{missing} is missing: give what is predicted (--outputs r) and what from (--inputs p,q,beta)"
            )
        split = [[name.strip() for name in given.split(",") if name.strip()] for given in (inputs, outputs)]
        return BankDetector(bank=bank_between(*split, look_s=number("--look", look, 0.0, 60.0)))
    source = detector or "C"
    recipe = find_detector(source)
    if is_recipe(recipe):
        return recipe
    raise InputError(f"--detector {source} is calibrated already; give the detector it came from")


def _imperfections(tolerate: str | None) -> Imperfections:
    from gtmbench.bench.sensors import parse_imperfections
    from gtmbench.study.healthy_records import CalibrationFlights

    return CalibrationFlights().imperfections if tolerate is None else parse_imperfections(tolerate)


def _on_part(recipe: Detector, logs: Sequence[Path], healthy: Sequence[str], **how: Any) -> _Taught:
    """Learn on a part of a log, as `gtmbench monitor` does before it watches the rest; how: as `taught_by` takes it."""
    from gtmbench.detectors.protocol import is_ready
    from gtmbench.log.watch import taught_by

    if len(logs) > 1:
        raise InputError(f"--healthy is a part of one log, and {len(logs)} are given; give one, or leave it out")
    given = [healthy_part(text) for text in healthy]
    spans = [part for part in given if not isinstance(part, Path)]
    if len(spans) < len(given):
        raise InputError("--healthy is a log; name logs that are healthy as a whole without --healthy")
    learnt = taught_by(logs[0], recipe, healthy=spans, **how)
    what = f"{sum(end_s - start_s for start_s, end_s in learnt.identified_s):.4g} s of {logs[0].name}"
    assert is_ready(learnt.monitor)
    return _Taught(monitor=learnt.monitor, what=what, attitude=learnt.opened.attitude)


def _on_logs(recipe: Detector, logs: Sequence[Path], attitude: str, rate: float | None, **how: Any) -> _Taught:
    """Learn on whole logs, which are read as `logged_records` takes it."""
    from gtmbench.log.opening.auto_bank import recipe_for_logs
    from gtmbench.study.healthy_records import logged_records

    recipe, origin = recipe_for_logs(recipe, logs, how["mapping"], attitude)
    records, provenance = logged_records(logs, recipe, **how)
    return replace(_calibrated(recipe, records, provenance, rate, how["progress"], "logs"), attitude=origin)


def _on_flights(recipe: Detector, given: Mapping[str, Any], rate: float | None, tell: Progress, **how: Any) -> _Taught:
    """Fly, and learn on these flights; how else they are is as `CalibrationFlights` takes it."""
    from gtmbench.study.healthy_records import CalibrationFlights

    tied = getattr(recipe, "tied_to_excitation", False)
    usual = {"flights": 2, "excitation": "dissertation"} if tied else {}
    wanted = CalibrationFlights(**{**usual, **given}, **how)
    records = wanted.records(recipe, processes=os.cpu_count() or 1, progress=tell)
    return _calibrated(recipe, records, wanted.provenance(recipe), rate, tell, "flights")


def _calibrated(
    recipe: Detector,
    records: Sequence[Record],
    origin: Mapping[str, object],
    rate: float | None,
    tell: Progress,
    of: str,
) -> _Taught:
    from gtmbench.detectors.protocol import with_provenance
    from gtmbench.detectors.statistics.thresholds import Luck

    learnt = recipe.calibrate(records, rate, progress=tell)
    monitor = with_provenance(learnt, {**origin, "records": len(records)})
    luck = Luck.from_provenance(monitor.provenance)
    if luck is not None:
        luck.check(len(records), of)
    return _Taught(monitor=monitor, what=counted(len(records), "record"), channels=records[0].channels)


def _print_calibrated(taught: _Taught) -> None:
    from gtmbench.detectors.bank_detector import BankMonitor
    from gtmbench.report.words.log import attitude_lines
    from gtmbench.report.words.monitor import origin_text

    monitor = taught.monitor
    if isinstance(monitor, BankMonitor):
        print_bank_monitor(monitor)
        say(attitude_lines(taught.attitude))
        return
    of = f" of {', '.join(taught.channels)}" if taught.channels else ""
    echo(f"{monitor.name}: calibrated on {taught.what}{of}")
    say(origin_text(monitor)[1:])


@click.command("export", cls=HeadedCommand)
@click.argument("monitor", metavar="MONITOR.json", type=PATH)
@click.option("--out", default="on_board", show_default=True, type=PATH, help="The folder of C code.")
@click.option(
    "--full/--compact",
    "full",
    default=True,
    help="Keep every sample of the minute before a window, or means of a few: half of the memory, and alarms may come "
    "a few samples sooner or later.  [default: full]",
)
@click.option("--force", is_flag=True, help="Write over files of the same names.")
@common_options
def export_command(monitor: Path, out: Path, full: bool, force: bool) -> None:
    """Write a calibrated bank as C99 for a flight controller: code, its own test and a README.

    Example: gtmbench export monitor.json --out on_board

    It detects faults with the noise that it learns in flight, says which sensors could be at fault by structure, and
    predicts each watched sensor. Which kind of fault it is, and how large, `gtmbench monitor` says on the flight's log.
    """
    from gtmbench.export.write import FILES, export_c

    claim_folder(out, force=force)
    exported = export_c(monitor, out, compact=not full, force=force)
    board = exported.board
    residuals = ", ".join(each.output for each in board.residuals)
    verdict = f"Wrote bank {board.name} with residuals of {residuals} as C, {exported.variant}: {out}."
    own = {
        "out": str(out),
        "files": FILES,
        "variant": exported.variant,
        "digest": exported.digest,
        "channels": board.channels,
        "residuals": [each.output for each in board.residuals],
        "sample_period_s": board.period_s,
    }
    test = f"test it: cmake -S {out} -B {out}/build && cmake --build {out}/build && ctest --test-dir {out}/build"
    finish(envelope("export", verdict, own), lambda: [test])
