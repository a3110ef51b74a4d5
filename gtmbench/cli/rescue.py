"""``gtmbench fly --rescue``: a departure beside its rescue."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from gtmbench.cli.aircraft import loaded_aircraft
from gtmbench.cli.output import claim_file, finish, shown_progress
from gtmbench.errors import InputError
from gtmbench.files.disk import atomic_write
from gtmbench.jobs.progress import Progress
from gtmbench.report.tables.envelope import envelope

if TYPE_CHECKING:
    from gtmbench.detectors.protocol import Monitor
    from gtmbench.faults.fault import Fault
    from gtmbench.study.rescue import Rescue


_FLIGHTS, _FLIGHT_S = 6, 200.0  # that the monitor is calibrated on, where none is given
_BEFORE_S, _AFTER_S = 20.0, 30.0  # the onset, and after it: a monitor has to come to rest first
_BANK, _SEED = "C-early", 660_001  # flights that nobody is rescued on


def fly_twice(
    out: Path | None,
    figure: Path | None,
    faults: tuple[Fault, ...],
    monitor_file: Path | None,
    *,
    aircraft: str,
    altitude: float | None,
    tas: float | None,
    without_io: bool,
    sensors: str | None,
    seed: int,
    force: bool,
) -> None:
    """Fly a gyro's fault twice, without accommodation and with it, into one recording."""
    from gtmbench.bench.sensor_chain import IDEAL
    from gtmbench.detectors.accommodate import Accommodate
    from gtmbench.detectors.monitor_file import load_monitor
    from gtmbench.faults.kinds.shaping import SignFlip
    from gtmbench.report.figures.rescue import rescue_figure
    from gtmbench.report.recording.rescue import write_rescue_recording
    from gtmbench.report.tables.results import event_rows
    from gtmbench.report.words.study import rescue_verdict
    from gtmbench.study.rescue import fly_rescue

    out = Path("rescue.rrd") if out is None else out
    _check_files(out, figure, force=force)
    faults = faults or (SignFlip(channel="r", onset_s=_BEFORE_S),)
    flown = loaded_aircraft(aircraft, altitude=altitude, tas=tas, without_io=without_io)
    with shown_progress() as tell:
        kept = load_monitor(monitor_file) if monitor_file else None
        sensors = sensors or (flown.loop_sensors if kept is None else str(kept.provenance.get("sensors", IDEAL)))
        flown.chain_of(sensors)
        monitor = _calibrated(aircraft, sensors, tell) if kept is None else kept
    onset_s = min(fault.onset_s for fault in faults)
    rescue = fly_rescue(
        faults,
        Accommodate(monitor),
        aircraft=flown,
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
    told = [{**row, "flight": name} for name, each in rescue.flights.items() for row in event_rows(each.events)]
    own = {"out": str(out), "figure": None if figure is None else str(figure), "onset_s": onset_s}
    result = envelope("fly-rescue", rescue_verdict(rescue), own, findings=told)
    finish(result, lambda: [*_lines(rescue), f"{out}: both flights; gtmbench view {out}"])


def _check_files(out: Path, figure: Path | None, *, force: bool) -> None:
    if out.suffix.lower() != ".rrd":
        raise InputError(f"--out is '{out}'; a recording's file ends in .rrd")
    if figure is not None and figure.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise InputError(f"--figure is '{figure}'; a picture's file ends in .png, .svg or .pdf")
    for file in filter(None, (out, figure)):
        claim_file(file, force=force)


def _lines(rescue: Rescue) -> Iterator[str]:
    from gtmbench.report.words.judgement import fault_text, loop_text

    for fault in rescue.faults:
        yield f"{fault.onset_s:g} s: {fault_text(fault)}"
    for name, flight in rescue.flights.items():
        for event in flight.events:
            yield f"{event.time_s:g} s, {name}: {loop_text(event)}"
        lost_ft = flight.truth["altitude"][0] - flight.truth["altitude"].min()
        yield f"{flight.truth.end_s:g} s, {name}: the flight ends, {lost_ft:.0f} ft of altitude were lost at most"


def _calibrated(aircraft: str, sensors: str, tell: Progress) -> Monitor:
    """Fly healthy, and calibrate: half a minute; a rescue is no study of false alarms."""
    from gtmbench.detectors.bank.bank import load_bank
    from gtmbench.detectors.bank_detector import BankDetector
    from gtmbench.study.healthy_records import CalibrationFlights

    flights = CalibrationFlights(flights=_FLIGHTS, duration_s=_FLIGHT_S, aircraft=aircraft, seed=_SEED, sensors=sensors)
    recipe = BankDetector(bank=load_bank(_BANK))
    records = flights.records(recipe, processes=os.cpu_count() or 1, progress=tell)
    return recipe.calibrate(records, progress=tell)
