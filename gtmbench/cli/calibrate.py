"""Commands about monitors: calibrate, bank."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import number
from gtmbench.cli.detectors import detector_option
from gtmbench.cli.output import attitude_option, claim_file, common_options, echo, map_option, print_json, print_table
from gtmbench.errors import InputError
from gtmbench.files.shipped import shipped_banks
from gtmbench.jobs.progress import progress_bar
from gtmbench.report.tables.envelope import envelope

if TYPE_CHECKING:
    from gtmbench.detectors.bank.bank import Bank
    from gtmbench.detectors.bank.detectability import Signatures
    from gtmbench.detectors.bank_detector import BankMonitor
    from gtmbench.detectors.protocol import Detector, Monitor
    from gtmbench.detectors.surfaces.surfaces import SurfaceDetector, SurfaceMonitor
    from gtmbench.method.attitude_origin import Origin
    from gtmbench.values.record import Record


@click.command("calibrate")
@click.argument("logs", nargs=-1, metavar="[HEALTHY_LOG ...]", type=click.Path(path_type=Path))
@map_option
@detector_option("The default is bank C.", calibrated=False)
@click.option(
    "--out", default="monitor.json", show_default=True, type=click.Path(path_type=Path), help="The monitor's file."
)
@click.option(
    "--false-alarms-per-hour",
    "rate",
    type=float,
    help="False alarms per flight hour to calibrate the whole monitor for; a detector that can't promise a rate "
    "refuses it.  [default: 0.002 for a bank]",
)
@click.option("--flights", type=int, help="Without logs: the number of flights to fly.  [default: 60]")
@click.option("--duration", type=float, help="Without logs: seconds of each flight.  [default: 500]")
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
    mapping: tuple[str, ...],
    detector: str | None,
    out: Path,
    rate: float | None,
    flights: int | None,
    duration: float | None,
    excitation: str | None,
    aircraft: str | None,
    tolerate: str | None,
    sensors: str | None,
    seed: int,
    attitude: str,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Calibrate a detector on healthy records and write a monitor. A bank is identified and gets its thresholds.

    It reads logs as `gtmbench monitor` does. Without logs it flies (by default the GTM) with the T2's sensor noise.
    The file holds numbers and names only; any process or machine that loads it gives the same verdicts bit for bit.
    The output states how much other flights would change the thresholds; more than three times is refused.
    """
    from gtmbench.bench.imperfections import parse_imperfections
    from gtmbench.detectors.monitor_file import save_monitor
    from gtmbench.report.words.monitor import facts
    from gtmbench.report.words.units import counted
    from gtmbench.study.healthy_records import CalibrationFlights, logged_records
    from gtmbench.study.log.auto_bank import recipe_for_logs
    from gtmbench.study.log.origin import FROM_LOG
    from gtmbench.study.watchers import with_provenance

    if out.suffix.lower() != ".json":
        raise InputError(f"--out is '{out}'; a monitor's file ends in .json")
    claim_file(out, force=force)
    rate = None if rate is None else number("--false-alarms-per-hour", rate, 1e-9, 1e3)
    recipe = _uncalibrated(detector or "C")
    imperfections = parse_imperfections(tolerate) if tolerate is not None else CalibrationFlights().imperfections
    of_flights = {
        "flights": flights,
        "duration_s": duration,
        "excitation": excitation,
        "aircraft": aircraft,
        "sensors": sensors,
    }
    given = {key: value for key, value in of_flights.items() if value is not None}
    usual = {"flights": 2, "excitation": "dissertation"} if getattr(recipe, "tied_to_excitation", False) else {}
    if logs and given:
        option = next(iter(given)).removesuffix("_s")
        raise InputError(f"--{option} is about flights, and with logs none is flown; leave out one or the other")
    if mapping and not logs:
        raise InputError("--map is about logs, and none is given; name the logs, or leave it out")
    if attitude != FROM_LOG and not logs:
        raise InputError("--attitude is about logs, and none is given; name the logs, or leave it out")
    wanted = CalibrationFlights(**(usual | given), seed=seed, imperfections=imperfections)  # type: ignore[arg-type]
    attitude_of_logs = None
    with progress_bar(silent=as_json or quiet) as tell:
        records: list[Record]
        if logs:
            recipe, attitude_of_logs = recipe_for_logs(recipe, logs, mapping, attitude)
            records, origin = logged_records(
                logs, recipe, mapping=mapping, imperfections=imperfections, seed=seed, progress=tell
            )
        else:
            records = wanted.records(recipe, processes=os.cpu_count() or 1, progress=tell)
            origin = wanted.provenance(recipe)
        monitor = with_provenance(recipe.calibrate(records, rate, progress=tell), origin | {"records": len(records)})
        _check_luck(monitor, len(records), "logs" if logs else "flights")
        save_monitor(monitor, out)
    bank = "bank " if getattr(monitor, "bank", None) else ""
    verdict = f"Calibrated {bank}{monitor.name} on {counted(len(records), 'record')}: {out}."
    if as_json:
        print_json(envelope("calibrate", verdict, {"out": str(out), "monitor": facts(monitor)}))
    elif not quiet:
        echo(verdict)
        _print_calibrated(monitor, records, attitude_of_logs)
        echo(f"monitor: {out} ({out.stat().st_size / 1000.0:.0f} kB)")


def _uncalibrated(source: str) -> Detector:
    from gtmbench.detectors.protocol import is_recipe
    from gtmbench.detectors.registry import find_detector

    recipe = find_detector(source)
    if is_recipe(recipe):
        return recipe
    raise InputError(f"--detector {source} is calibrated already; give the detector it came from")


def _check_luck(monitor: Monitor, records: int, what: str) -> None:
    from gtmbench.detectors.statistics.thresholds import Luck

    luck = Luck.told(monitor.provenance)
    if luck is not None:
        luck.check(records, what)


def _print_calibrated(monitor: Monitor, records: Sequence[Record], attitude: Origin | None) -> None:
    from gtmbench.detectors.bank_detector import BankMonitor
    from gtmbench.report.words.log import attitude_lines
    from gtmbench.report.words.monitor import origin_text

    if isinstance(monitor, BankMonitor):
        _print_monitor(monitor)
        for line in attitude_lines(attitude):
            echo(line)
        return
    echo(f"{monitor.name}: calibrated on {len(records)} records of {', '.join(records[0].channels)}")
    for line in origin_text(monitor)[1:]:
        echo(line)


def _print_monitor(monitor: BankMonitor) -> None:
    from gtmbench.report.words.monitor import facts_text, residual_rows

    columns, rows, right = residual_rows(monitor)
    print_table(f"bank {monitor.bank.name}: {monitor.bank.title}", columns, rows, right=right)
    for line in facts_text(monitor):
        echo(line)


@click.command("bank")
@click.argument("source", required=False, metavar="[NAME|FILE.toml|MONITOR.json]")
@click.option(
    "--of", "log", type=click.Path(path_type=Path), metavar="LOG", help="For bank auto: the log it is made of."
)
@common_options
def bank_command(source: str | None, log: Path | None, as_json: bool, quiet: bool) -> None:
    """Show a bank: its residuals, which fault enters which, and its blind spots. Without a name, list the banks.

    For a monitor's file, also show its calibration and the faults that it can't detect. `surfaces`, which knows the
    commands, has equations of the aircraft's answer instead of residuals. `auto --of LOG` is the bank that a log's
    channels allow; beside it stands what the log's other sensors are compared with.
    """
    from gtmbench.detectors.bank.bank import load_bank
    from gtmbench.detectors.bank.composed import AUTO
    from gtmbench.detectors.bank.detectability import signatures
    from gtmbench.detectors.bank_detector import BankMonitor
    from gtmbench.detectors.monitor_file import load_monitor
    from gtmbench.detectors.surfaces.surfaces import SURFACE_DETECTORS, SurfaceDetector, SurfaceMonitor
    from gtmbench.report.words.monitor import facts

    if source == AUTO or log is not None:
        _print_auto(source, log, as_json, quiet)
        return
    if source is None:
        _list_banks(as_json, quiet)
        return
    if source in SURFACE_DETECTORS:
        _print_surfaces(SURFACE_DETECTORS[source], None, as_json, quiet)
        return
    monitor = load_monitor(source) if source.lower().endswith(".json") else None
    if isinstance(monitor, SurfaceMonitor):
        _print_surfaces(SurfaceDetector(name=monitor.name, flow=monitor.answer.flow), monitor, as_json, quiet)
        return
    if monitor is not None and not isinstance(monitor, BankMonitor):
        raise InputError(f"{source} is a monitor of '{monitor.name}', which is no bank: it has no residuals to show")
    bank = monitor.bank if monitor is not None else load_bank(source)
    table = signatures(monitor if monitor is not None else bank)
    verdict = _bank_verdict(bank)
    if as_json:
        own = {**_bank_json(table), "monitor": None if monitor is None else facts(monitor), "other_sensors": []}
        print_json(envelope("bank", verdict, own))
    elif not quiet:
        echo(verdict)
        if monitor is None:
            _print_residuals(bank)
        else:
            _print_monitor(monitor)
        _print_signatures(table)


def _bank_verdict(bank: Bank) -> str:
    from gtmbench.report.words.units import counted

    residuals = counted(len(bank.residuals), "residual")
    return f"Bank {bank.name} has {residuals}, of {', '.join(spec.output for spec in bank.residuals)}."


def _print_auto(source: str | None, log: Path | None, as_json: bool, quiet: bool) -> None:
    from gtmbench.detectors.bank.composed import AUTO
    from gtmbench.detectors.bank.detectability import signatures
    from gtmbench.intake.other_sensors import other_sensors_of
    from gtmbench.intake.read import read_log
    from gtmbench.report.words.other_sensors import possible_lines
    from gtmbench.study.log.auto_bank import bank_for_logs

    if source != AUTO:
        raise InputError(
            f"--of {log} goes with bank {AUTO}, and {source or 'no bank'} is given: gtmbench bank {AUTO} --of LOG"
        )
    if log is None:
        raise InputError(
            f"bank {AUTO} is made of a log's channels: gtmbench bank {AUTO} --of LOG; `gtmbench bank MONITOR.json` "
            "shows one that `gtmbench monitor --save` has written"
        )
    read = read_log(log)
    bank = bank_for_logs([read], ())[0].bank
    sensors = possible_lines(other_sensors_of(read))
    if as_json:
        own = {**_bank_json(signatures(bank)), "monitor": None, "other_sensors": [line.strip() for line in sensors[1:]]}
        print_json(envelope("bank", _bank_verdict(bank), own))
    elif not quiet:
        echo(_bank_verdict(bank))
        _print_residuals(bank)
        _print_signatures(signatures(bank))
        for line in sensors:
            echo(line)


def _print_surfaces(detector: SurfaceDetector, monitor: SurfaceMonitor | None, as_json: bool, quiet: bool) -> None:
    from gtmbench.report.words.monitor import facts, origin_text
    from gtmbench.report.words.surfaces import EQUATIONS, effect_rows, equation_rows

    rows = equation_rows(detector.flow, None if monitor is None else monitor.suspects)
    unwatched = {} if monitor is None else monitor.unwatched
    verdict = f"{detector.name} has {len(rows)} equations, of {', '.join(row[0] for row in rows)}: {detector.title}."
    if as_json:
        own = {
            "name": detector.name,
            "channels": list(detector.channels),
            "equations": {row[0]: dict(zip(EQUATIONS[1:], row[1:], strict=True)) for row in rows},
            "effects": None if monitor is None else monitor.answer.effects.tolist(),
            "unwatched": unwatched,
            "monitor": None if monitor is None else facts(monitor),
        }
        print_json(envelope("bank", verdict, own))
    elif not quiet:
        echo(verdict)
        print_table("Equations, by the dynamic pressure", list(EQUATIONS), rows)
        if monitor is not None:
            columns, found = effect_rows(monitor)
            print_table("Effects as identified, a degree", columns, found, right=columns[1:])
            for line in [*(f"{name} is not watched: {why}" for name, why in unwatched.items()), *origin_text(monitor)]:
                echo(line)
        echo("from which size on a fault is detected: gtmbench monitor LOG --detector MONITOR.json, its last table")


def _list_banks(as_json: bool, quiet: bool) -> None:
    from gtmbench.detectors.bank.bank import load_bank

    banks = [load_bank(name) for name in shipped_banks()]
    verdict = f"{len(banks)} banks ship with gtmbench."
    if as_json:
        own = {bank.name: {"title": bank.title, "channels": list(bank.channels)} for bank in banks}
        print_json(envelope("bank-list", verdict, {"banks": own}))
    elif not quiet:
        echo(verdict)
        rows = [[bank.name, bank.title, " ".join(bank.channels)] for bank in banks]
        print_table("Banks", ["name", "predicts", "needs"], rows)
        echo("one of them: gtmbench bank C; a copy of its TOML file with other residuals: gtmbench bank FILE.toml")


def _print_residuals(bank: Bank) -> None:
    rows = [
        [spec.output, " ".join(spec.inputs), f"{spec.look_back_s:g}", f"{spec.look_ahead_s:g}"]
        for spec in bank.residuals
    ]
    names = ["residual", "predicted from", "look-back (s)", "look-ahead (s)"]
    print_table(f"bank {bank.name}: {bank.title}", names, rows, right=names[2:])


def _print_signatures(table: Signatures) -> None:
    from gtmbench.detectors.bank.isolability import isolability
    from gtmbench.report.words.isolation import isolation_lines

    rows = [[name, *table.pattern[name]] for name in table.channels]
    print_table("Fault signatures", ["fault of", *(f"in {output}" for output in table.outputs)], rows)
    echo("level: any error of the channel enters the residual; slope: only changes of the error do")
    for line in isolation_lines(isolability(table.bank)):
        echo(line)
    echo("Blind spots", bold=True)
    for line in table.blind_spots:
        echo(f"- {line}")


def _bank_json(table: Signatures) -> dict[str, Any]:
    from gtmbench.detectors.bank.bank import bank_table
    from gtmbench.detectors.bank.isolability import isolability

    pattern = {name: dict(zip(table.outputs, table.pattern[name], strict=True)) for name in table.channels}
    return {
        "name": table.bank.name,
        **bank_table(table.bank),
        "channels": list(table.channels),
        "signatures": pattern,
        "told_apart": isolability(table.bank).table(),
        "blind_spots": list(table.blind_spots),
    }
