"""``gtmbench list``: every name that there is, told without importing what Python would say; and what a bank holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gtmbench.cli.output import PATH, HeadedCommand, common_options, echo, finish, print_table, say, told_names
from gtmbench.errors import InputError
from gtmbench.files.plain import envelope
from gtmbench.files.shipped import share, shipped_aircraft, shipped_banks, shipped_campaigns, shipped_scenarios
from gtmbench.files.writing import read_toml
from gtmbench.imports import DETECTORS, FAULTS, installed
from gtmbench.values.channels import CHANNELS

if TYPE_CHECKING:
    from gtmbench.detectors.bank.bank import Bank
    from gtmbench.detectors.bank_detector import BankMonitor
    from gtmbench.detectors.surfaces.surfaces import SurfaceDetector, SurfaceMonitor


@click.command("list", cls=HeadedCommand)
@click.argument("name", required=False, metavar="[BANK|FILE.toml|MONITOR.json]")
@click.option("--of", "log", type=PATH, metavar="LOG", help="For bank auto: the log it is made of.")
@click.option("--all", "with_all", is_flag=True, help="Also list the aircraft that come with JSBSim.")
@common_options
def list_command(name: str | None, log: Path | None, with_all: bool) -> None:
    """List every name that there is to type, or show what one bank of detectors can isolate.

    Example: gtmbench list C

    Without a name: aircraft, channels, excitations, faults, scenarios, campaigns, detectors, banks, pseudo inputs. Of
    a bank: its residuals, which fault enters which, and its blind spots; of a monitor's file also its calibration and
    the faults that it can't detect. `auto --of LOG` is the bank that a log's channels allow.
    """
    if name is not None:
        _show_bank(name, log)
        return
    if log is not None:
        raise InputError(f"--of {log} goes with bank auto: gtmbench list auto --of LOG")
    sections = listing()
    if with_all:
        from gtmbench.bench.known_aircraft import jsbsim_titles

        sections["aircraft"] |= jsbsim_titles()
    counts = ", ".join(f"{len(entries)} {_title(key)}" for key, entries in sections.items())

    def rest() -> None:
        for title, entries in sections.items():
            echo(_title(title), bold=True)
            width = max(map(len, entries), default=0)
            for name, meaning in entries.items():
                echo(f"  {name:<{max(width, 16)}} {meaning}")
            if title == "aircraft" and not with_all:
                known = read_toml(share() / "aircraft/jsbsim.toml", "list of aircraft")
                echo(f"  and {len(known)} that come with JSBSim (--all), or a folder of yours")

    finish(envelope("list", f"There are {counts}.", sections), rest)


def _title(key: str) -> str:
    return key.replace("_", " ")


def listing() -> dict[str, dict[str, str]]:
    """Return what there is, section by section: names, and what each is in a line."""
    told = told_names()
    banks = _titles(shipped_banks())
    # in the order in which a name is looked up
    detectors = told["detectors"] | banks | told["rivals"] | told["surfaces"]
    return {
        "aircraft": _titles({name: share() / "aircraft" / name / "aircraft.toml" for name in shipped_aircraft()}),
        "channels": {c.name: f"{c.unit}, {c.meaning}" for c in CHANNELS.values()},
        "excitations": told["excitations"],
        "faults": told["faults"] | _installed(FAULTS),
        "scenarios": _titles(shipped_scenarios()),
        "campaigns": _titles(shipped_campaigns()),
        "detectors": detectors | {name: of for name, of in _installed(DETECTORS).items() if name not in detectors},
        "banks": banks,
        "pseudo_inputs": told["pseudo_inputs"],
    }


def _titles(paths: Mapping[str, Path]) -> dict[str, str]:
    return {name: read_toml(path, "file that ships")["title"] for name, path in paths.items()}


def _installed(group: str) -> dict[str, str]:
    return {name: f"installed: {place}" for name, place in installed(group).items()}


def _show_bank(source: str, log: Path | None) -> None:
    """Show a bank's residuals, which fault enters which, and its blind spots; of a monitor also its calibration.

    `surfaces`, which knows the commands, has equations of the aircraft's answer instead of residuals. `auto` of a log
    is the bank that the log's channels allow; beside it stands what the log's other sensors are compared with.
    """
    from gtmbench.detectors.bank.bank import load_bank
    from gtmbench.detectors.bank.composed import AUTO
    from gtmbench.detectors.bank_detector import BankMonitor
    from gtmbench.detectors.monitor_file import load_monitor
    from gtmbench.detectors.surfaces.surfaces import SURFACE_DETECTORS, SurfaceDetector, SurfaceMonitor

    if source == AUTO or log is not None:
        _show_auto(source, log)
        return
    if source in SURFACE_DETECTORS:
        _show_surfaces(SURFACE_DETECTORS[source], None)
        return
    monitor = load_monitor(source) if source.lower().endswith(".json") else None
    if isinstance(monitor, SurfaceMonitor):
        _show_surfaces(SurfaceDetector(name=monitor.name, flow=monitor.answer.frame.flow), monitor)
        return
    if monitor is not None and not isinstance(monitor, BankMonitor):
        raise InputError(f"{source} is a monitor of '{monitor.name}', which is no bank: it has no residuals to show")
    _finish_bank(load_bank(source) if monitor is None else monitor.bank, monitor)


def print_bank_monitor(monitor: BankMonitor) -> None:
    """Print the residuals and the calibration of a monitor that is a bank."""
    from gtmbench.report.words.monitor import facts_text, residual_rows

    columns, rows, right = residual_rows(monitor)
    print_table(f"bank {monitor.bank.name}: {monitor.bank.title}", columns, rows, right=right)
    say(facts_text(monitor))


def _show_auto(source: str, log: Path | None) -> None:
    from gtmbench.detectors.bank.composed import AUTO
    from gtmbench.intake.other_sensors import other_sensors_of
    from gtmbench.intake.read import read_log
    from gtmbench.log.opening.auto_bank import bank_for_logs
    from gtmbench.report.words.others import sensor_lines

    if source != AUTO:
        raise InputError(f"--of {log} goes with bank {AUTO}, and {source} is given: gtmbench list {AUTO} --of LOG")
    if log is None:
        raise InputError(
            f"bank {AUTO} is made of a log's channels: gtmbench list {AUTO} --of LOG; `gtmbench list MONITOR.json` "
            "shows one that `gtmbench calibrate` has written"
        )
    read = read_log(log)
    bank = bank_for_logs([read], ())[0].bank
    _finish_bank(bank, None, sensor_lines([each for each in other_sensors_of(read) if each.is_read]))


def _finish_bank(bank: Bank, monitor: BankMonitor | None, sensors: Sequence[str] = ()) -> None:
    from gtmbench.detectors.bank.bank import bank_table
    from gtmbench.detectors.bank.detectability import isolability, signatures
    from gtmbench.report.words.monitor import facts, isolation_lines
    from gtmbench.report.words.units import counted

    table, told = signatures(bank if monitor is None else monitor), isolability(bank)
    residuals = counted(len(bank.residuals), "residual")
    verdict = f"Bank {bank.name} has {residuals}, of {', '.join(spec.output for spec in bank.residuals)}."

    def rest() -> Iterator[str]:
        if monitor is None:
            names = ["residual", "predicted from", "look-back (s)", "look-ahead (s)"]
            rows = [
                [each.output, " ".join(each.inputs), f"{each.look_back_s:g}", f"{each.look_ahead_s:g}"]
                for each in bank.residuals
            ]
            print_table(f"bank {bank.name}: {bank.title}", names, rows, right=names[2:])
        else:
            print_bank_monitor(monitor)
        rows = [[name, *table.pattern[name]] for name in table.channels]
        print_table("Fault signatures", ["fault of", *(f"in {output}" for output in table.outputs)], rows)
        yield "level: any error of the channel enters the residual; slope: only changes of the error do"
        yield from isolation_lines(told)
        echo("Blind spots", bold=True)
        yield from (f"- {line}" for line in table.blind_spots)
        yield from sensors

    own = {
        "name": bank.name,
        **bank_table(bank),
        "channels": table.channels,
        "signatures": {name: dict(zip(table.outputs, table.pattern[name], strict=True)) for name in table.channels},
        "told_apart": told.table(),
        "blind_spots": table.blind_spots,
        "monitor": None if monitor is None else facts(monitor),
        "other_sensors": [line.strip() for line in sensors[1:]],
    }
    finish(envelope("list-bank", verdict, own), rest)


def _show_surfaces(detector: SurfaceDetector, monitor: SurfaceMonitor | None) -> None:
    from gtmbench.report.words.monitor import EQUATIONS, effect_rows, equation_rows, facts, origin_text

    rows = equation_rows(detector.flow, None if monitor is None else monitor.suspects)
    unwatched = {} if monitor is None else monitor.unwatched
    verdict = f"{detector.name} has {len(rows)} equations, of {', '.join(row[0] for row in rows)}: {detector.title}."

    def rest() -> Iterator[str]:
        print_table("Equations, by the dynamic pressure", list(EQUATIONS), rows)
        if monitor is not None:
            columns, found = effect_rows(monitor)
            print_table("Effects as identified, a degree", columns, found, right=columns[1:])
            yield from (f"{name} is not watched: {why}" for name, why in unwatched.items())
            yield from origin_text(monitor)
        yield "from which size on a fault is detected: gtmbench monitor LOG --detector MONITOR.json, its last table"

    own = {
        "name": detector.name,
        "channels": detector.channels,
        "equations": {row[0]: dict(zip(EQUATIONS[1:], row[1:], strict=True)) for row in rows},
        "effects": None if monitor is None else monitor.answer.effects,
        "unwatched": unwatched,
        "monitor": None if monitor is None else facts(monitor),
    }
    finish(envelope("list-bank", verdict, own), rest)
