"""Commands about monitors: calibrate, bank."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import number
from gtmbench.cli.detectors import detector_option
from gtmbench.cli.output import attitude_option, claim_file, common_options, echo, print_json, print_table
from gtmbench.errors import InputError
from gtmbench.progress import progress_bar
from gtmbench.shipped import shipped_banks

if TYPE_CHECKING:
    from gtmbench.detectors.bank.bank import Bank
    from gtmbench.detectors.bank.detectability import Signatures
    from gtmbench.detectors.bank_detector import BankMonitor
    from gtmbench.detectors.protocol import Detector, Monitor
    from gtmbench.method.attitude_origin import Origin
    from gtmbench.record import Record


@click.command("calibrate")
@click.argument("logs", nargs=-1, metavar="[HEALTHY_LOG ...]", type=click.Path(path_type=Path))
@click.option(
    "--map",
    "mapping",
    multiple=True,
    metavar="CHANNEL=COLUMN:UNIT",
    help="What a log's column is, where its name doesn't say: p=gyro_x:rad/s, nz=-az:m/s2, time=stamp:us.",
)
@detector_option("Bank C unless told.", alias="--bank", calibrated=False)
@click.option(
    "--out", default="monitor.json", show_default=True, type=click.Path(path_type=Path), help="The monitor's file."
)
@click.option(
    "--false-alarms-per-hour",
    "rate",
    type=float,
    help="Wanted of the whole monitor in flight; refused by a detector that can't promise one.  "
    "[default: 0.002 of a bank]",
)
@click.option("--flights", type=int, help="How many are flown, without logs.  [default: 60]")
@click.option("--duration", type=float, help="Seconds each.  [default: 500]")
@click.option("--excitation", help="A name of `gtmbench list`, or a sum.  [default: multisine+turbulence]")
@click.option("--aircraft", help="A name of `gtmbench list --all`, or a folder.  [default: gtm]")
@click.option(
    "--tolerate",
    metavar="TEXT",
    help="Imperfections of healthy gyros that must not alarm, such as bias=0.5,wander=0.002,lag=0.005,quantum=0.05.",
)
@click.option("--seed", default=1, show_default=True, help="Of the first flight, its noise and imperfections.")
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
    seed: int,
    attitude: str,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Calibrate a detector on healthy records (a bank: identify, and set thresholds), and write a monitor.

    Logs as `gtmbench monitor` reads them; without any: flights (of the GTM, unless told) with the T2's sensor noise.
    The file holds numbers and names only, and another process or machine that loads it judges bit for bit alike.
    It says what thresholds owe to the luck of these flights, and refuses where that is more than three times.
    """
    from gtmbench.bench.imperfections import parse_imperfections
    from gtmbench.detectors.files import save_monitor
    from gtmbench.report.words.monitor import facts
    from gtmbench.study.calibration import with_provenance
    from gtmbench.study.healthy_records import CalibrationFlights, logged_records
    from gtmbench.study.log.auto import recipe_for_logs
    from gtmbench.study.log.origin import FROM_LOG

    if out.suffix.lower() != ".json":
        raise InputError(f"--out is '{out}'; a monitor's file ends in .json")
    claim_file(out, force=force)
    rate = None if rate is None else number("--false-alarms-per-hour", rate, 1e-9, 1e3)
    recipe = _uncalibrated(detector or "C")
    imperfections = parse_imperfections(tolerate) if tolerate is not None else CalibrationFlights().imperfections
    of_flights = {"flights": flights, "duration_s": duration, "excitation": excitation, "aircraft": aircraft}
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
            origin = wanted.provenance()
        monitor = with_provenance(recipe.calibrate(records, rate, progress=tell), origin | {"records": len(records)})
        _check_luck(monitor, len(records), "logs" if logs else "flights")
        save_monitor(monitor, out)
    if as_json:
        print_json(facts(monitor) | {"out": str(out)})
    elif not quiet:
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
@common_options
def bank_command(source: str | None, as_json: bool, quiet: bool) -> None:
    """Show a bank: its residuals, which fault enters which, and what it can't see. Without a name: list the banks.

    Of a monitor's file, also what it was calibrated on and what that lets pass.
    """
    from gtmbench.detectors.bank.bank import load_bank
    from gtmbench.detectors.bank.composed import AUTO
    from gtmbench.detectors.bank.detectability import signatures
    from gtmbench.detectors.bank_detector import BankMonitor
    from gtmbench.detectors.files import load_monitor
    from gtmbench.report.words.monitor import facts

    if source is None:
        _list_banks(as_json, quiet)
        return
    if source == AUTO:
        raise InputError(
            f"bank {AUTO} is made of a log's channels: `gtmbench monitor LOG` says which it would be, and `gtmbench "
            "bank MONITOR.json` shows one that `gtmbench monitor --save` has written"
        )
    monitor = load_monitor(source) if source.lower().endswith(".json") else None
    if monitor is not None and not isinstance(monitor, BankMonitor):
        raise InputError(f"{source} is a monitor of '{monitor.name}', which is no bank: it has no residuals to show")
    bank = monitor.bank if monitor is not None else load_bank(source)
    table = signatures(monitor if monitor is not None else bank)
    if as_json:
        print_json(_bank_json(table) | ({} if monitor is None else {"monitor": facts(monitor)}))
    elif not quiet:
        if monitor is None:
            _print_residuals(bank)
        else:
            _print_monitor(monitor)
        _print_signatures(table)


def _list_banks(as_json: bool, quiet: bool) -> None:
    from gtmbench.detectors.bank.bank import load_bank

    banks = [load_bank(name) for name in shipped_banks()]
    if as_json:
        print_json({"banks": {bank.name: {"title": bank.title, "channels": list(bank.channels)} for bank in banks}})
    elif not quiet:
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
