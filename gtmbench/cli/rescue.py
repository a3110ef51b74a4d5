"""The command rescue: a departure beside its rescue."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gtmbench.cli.aircraft import aircraft_options, told_aircraft
from gtmbench.cli.faults import chosen_faults, fault_options
from gtmbench.cli.output import claim_file, common_options, echo, print_json
from gtmbench.errors import InputError
from gtmbench.files.disk import atomic_write
from gtmbench.jobs.progress import Progress, progress_bar
from gtmbench.report.tables.envelope import envelope

if TYPE_CHECKING:
    from gtmbench.detectors.protocol import Monitor
    from gtmbench.faults.fault import Fault
    from gtmbench.study.rescue import Rescue


_FLIGHTS, _FLIGHT_S = 6, 200.0  # that the monitor is calibrated on, where none is given
_BEFORE_S, _AFTER_S = 20.0, 30.0  # the onset, and after it: a monitor has to come to rest first
_BANK, _SEED = "C-early", 660_001  # flights that nobody is rescued on


@click.command("rescue")
@click.option(
    "--out", default="rescue.rrd", show_default=True, type=click.Path(path_type=Path), help="The recording to write."
)
@click.option("--figure", type=click.Path(path_type=Path), help="Also write a figure: .png, .svg or .pdf.")
@aircraft_options
@fault_options("The fault.  [default: r's sign flips]")
@click.option(
    "--sensors",
    metavar="ideal|chain",
    help="chain: the aircraft's own delays, filters and sample rates lie between motion and readings.  "
    "[default: those of the monitor that is given; else chain, where gains are known for it]",
)
@click.option("--seed", default=1, show_default=True, help="Seed of turbulence and noise.")
@click.option(
    "--calibrated",
    "monitor_file",
    type=click.Path(path_type=Path),
    metavar="MONITOR.json",
    help=f"A monitor from `gtmbench calibrate`.  [default: bank {_BANK}, calibrated now on {_FLIGHTS} flights]",
)
@click.option("--force", is_flag=True, help="Write over existing files.")
@common_options
def rescue_command(
    out: Path,
    figure: Path | None,
    name: str,
    altitude: float | None,
    tas: float | None,
    without_io: bool,
    given: tuple[str, ...],
    onset: float | None,
    trial: int | None,
    sensors: str | None,
    seed: int,
    monitor_file: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Fly a gyro's fault twice, without accommodation and with it, into one recording.

    The autopilot flies on the sensor readings. On the second flight a monitor isolates the broken gyro and takes its
    reading out of the loop. `gtmbench view FILE.rrd` shows both aircraft beside each other.
    """
    from gtmbench.bench.sensor_chain import IDEAL
    from gtmbench.detectors.accommodate import Accommodate
    from gtmbench.detectors.monitor_file import load_monitor
    from gtmbench.report.figures.rescue import rescue_figure
    from gtmbench.report.recording.rescue import write_rescue_recording
    from gtmbench.study.rescue import fly_rescue

    _check_files(out, figure, force=force)
    faults = chosen_faults(given, onset, trial).faults or _own_faults()
    silent = as_json or quiet
    aircraft = told_aircraft(name, altitude=altitude, tas=tas, without_io=without_io, silent=silent)
    with progress_bar(silent=silent) as tell:
        kept = load_monitor(monitor_file) if monitor_file else None
        sensors = sensors or (aircraft.loop_sensors if kept is None else str(kept.provenance.get("sensors", IDEAL)))
        aircraft.chain_of(sensors)
        monitor = _calibrated(name, sensors, tell) if kept is None else kept
    onset_s = min(fault.onset_s for fault in faults)
    rescue = fly_rescue(
        faults,
        Accommodate(monitor),
        aircraft=aircraft,
        duration_s=onset_s + _AFTER_S,
        seed=seed,
        sensors=sensors,
        altitude_ft=altitude,
        tas_kt=tas,
    )
    write_rescue_recording(rescue, out)
    if figure is not None:
        with atomic_write(figure) as aside:
            rescue_figure(rescue).savefig(aside, dpi=150)
    if as_json:
        from gtmbench.report.tables.loop import event_rows
        from gtmbench.report.words.study import rescue_verdict

        told = [{**row, "flight": name} for name, each in rescue.flights.items() for row in event_rows(each.events)]
        own = {"out": str(out), "figure": None if figure is None else str(figure), "onset_s": onset_s}
        print_json(envelope("rescue", rescue_verdict(rescue), own, findings=told))
    elif not quiet:
        _print(rescue)
        echo(f"{out}: both flights; gtmbench view {out}")


def _own_faults() -> tuple[Fault, ...]:
    from gtmbench.faults.shaping import SignFlip

    return (SignFlip(channel="r", onset_s=_BEFORE_S),)


def _check_files(out: Path, figure: Path | None, *, force: bool) -> None:
    if out.suffix.lower() != ".rrd":
        raise InputError(f"--out is '{out}'; a recording's file ends in .rrd")
    if figure is not None and figure.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise InputError(f"--figure is '{figure}'; a picture's file ends in .png, .svg or .pdf")
    for file in filter(None, (out, figure)):
        claim_file(file, force=force)


def _print(rescue: Rescue) -> None:
    from gtmbench.report.words.judgement import fault_text, loop_text
    from gtmbench.report.words.study import rescue_verdict

    echo(rescue_verdict(rescue))
    for fault in rescue.faults:
        echo(f"{fault.onset_s:g} s: {fault_text(fault)}")
    for name, flight in rescue.flights.items():
        for event in flight.events:
            echo(f"{event.time_s:g} s, {name}: {loop_text(event)}")
        lost_ft = flight.truth["altitude"][0] - flight.truth["altitude"].min()
        echo(f"{flight.truth.end_s:g} s, {name}: the flight ends, {lost_ft:.0f} ft of altitude were lost at most")


def _calibrated(aircraft: str, sensors: str, tell: Progress) -> Monitor:
    """Fly healthy, and calibrate: half a minute; a rescue is no study of false alarms."""
    from gtmbench.detectors.bank.bank import load_bank
    from gtmbench.detectors.bank_detector import BankDetector
    from gtmbench.study.healthy_records import CalibrationFlights

    flights = CalibrationFlights(flights=_FLIGHTS, duration_s=_FLIGHT_S, aircraft=aircraft, seed=_SEED, sensors=sensors)
    recipe = BankDetector(bank=load_bank(_BANK))
    records = flights.records(recipe, processes=os.cpu_count() or 1, progress=tell)
    return recipe.calibrate(records, progress=tell)
