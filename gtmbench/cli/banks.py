"""What `gtmbench list NAME` shows of a bank, or of a monitor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from gtmbench.cli.output import echo, print_json, print_table
from gtmbench.errors import InputError
from gtmbench.report.tables.envelope import envelope

if TYPE_CHECKING:
    from gtmbench.detectors.bank.bank import Bank
    from gtmbench.detectors.bank.detectability import Signatures
    from gtmbench.detectors.bank_detector import BankMonitor
    from gtmbench.detectors.surfaces.surfaces import SurfaceDetector, SurfaceMonitor


def show_bank(source: str, log: Path | None, *, as_json: bool, quiet: bool) -> None:
    """Show a bank's residuals, which fault enters which, and its blind spots; of a monitor also its calibration.

    `surfaces`, which knows the commands, has equations of the aircraft's answer instead of residuals. `auto` of a log
    is the bank that the log's channels allow; beside it stands what the log's other sensors are compared with.
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
        print_json(envelope("list-bank", verdict, own))
    elif not quiet:
        echo(verdict)
        if monitor is None:
            _print_residuals(bank)
        else:
            print_bank_monitor(monitor)
        _print_signatures(table)


def print_bank_monitor(monitor: BankMonitor) -> None:
    """Print the residuals and the calibration of a monitor that is a bank."""
    from gtmbench.report.words.monitor import facts_text, residual_rows

    columns, rows, right = residual_rows(monitor)
    print_table(f"bank {monitor.bank.name}: {monitor.bank.title}", columns, rows, right=right)
    for line in facts_text(monitor):
        echo(line)


def _bank_verdict(bank: Bank) -> str:
    from gtmbench.report.words.units import counted

    residuals = counted(len(bank.residuals), "residual")
    return f"Bank {bank.name} has {residuals}, of {', '.join(spec.output for spec in bank.residuals)}."


def _print_auto(source: str, log: Path | None, as_json: bool, quiet: bool) -> None:
    from gtmbench.detectors.bank.composed import AUTO
    from gtmbench.detectors.bank.detectability import signatures
    from gtmbench.intake.other_sensors import other_sensors_of
    from gtmbench.intake.read import read_log
    from gtmbench.report.words.other_sensors import sensor_lines
    from gtmbench.study.log.auto_bank import bank_for_logs

    if source != AUTO:
        raise InputError(f"--of {log} goes with bank {AUTO}, and {source} is given: gtmbench list {AUTO} --of LOG")
    if log is None:
        raise InputError(
            f"bank {AUTO} is made of a log's channels: gtmbench list {AUTO} --of LOG; `gtmbench list MONITOR.json` "
            "shows one that `gtmbench calibrate` has written"
        )
    read = read_log(log)
    bank = bank_for_logs([read], ())[0].bank
    sensors = sensor_lines([each for each in other_sensors_of(read) if each.is_read])
    if as_json:
        own = {**_bank_json(signatures(bank)), "monitor": None, "other_sensors": [line.strip() for line in sensors[1:]]}
        print_json(envelope("list-bank", _bank_verdict(bank), own))
    elif not quiet:
        echo(_bank_verdict(bank))
        _print_residuals(bank)
        _print_signatures(signatures(bank))
        for line in sensors:
            echo(line)


def _print_surfaces(detector: SurfaceDetector, monitor: SurfaceMonitor | None, as_json: bool, quiet: bool) -> None:
    from gtmbench.report.words.monitor import EQUATIONS, effect_rows, equation_rows, facts, origin_text

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
        print_json(envelope("list-bank", verdict, own))
    elif not quiet:
        echo(verdict)
        print_table("Equations, by the dynamic pressure", list(EQUATIONS), rows)
        if monitor is not None:
            columns, found = effect_rows(monitor)
            print_table("Effects as identified, a degree", columns, found, right=columns[1:])
            for line in [*(f"{name} is not watched: {why}" for name, why in unwatched.items()), *origin_text(monitor)]:
                echo(line)
        echo("from which size on a fault is detected: gtmbench monitor LOG --detector MONITOR.json, its last table")


def _print_residuals(bank: Bank) -> None:
    rows = [
        [spec.output, " ".join(spec.inputs), f"{spec.look_back_s:g}", f"{spec.look_ahead_s:g}"]
        for spec in bank.residuals
    ]
    names = ["residual", "predicted from", "look-back (s)", "look-ahead (s)"]
    print_table(f"bank {bank.name}: {bank.title}", names, rows, right=names[2:])


def _print_signatures(table: Signatures) -> None:
    from gtmbench.detectors.bank.isolability import isolability
    from gtmbench.report.words.monitor import isolation_lines

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
