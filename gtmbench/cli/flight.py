"""``gtmbench fly``: a flight, into a log, sent live, or flown twice to show a rescue."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from gtmbench.checks import number
from gtmbench.cli.aircraft import aircraft_options, loaded_aircraft
from gtmbench.cli.options import chosen_faults, fault_options, refuse
from gtmbench.cli.output import PATH, HeadedCommand, claim_file, common_options, echo, finish, is_silent, shown_progress
from gtmbench.errors import InputError
from gtmbench.files.plain import envelope
from gtmbench.files.writing import atomic_write
from gtmbench.jobs.progress import Progress

if TYPE_CHECKING:
    from gtmbench.bench.aircraft import Aircraft
    from gtmbench.bench.loop_flight import ControllerError, LoopEvent, LoopFlight
    from gtmbench.detectors.protocol import Monitor
    from gtmbench.faults.fault import Fault
    from gtmbench.study.run import Rescue
    from gtmbench.values.record import Record


@click.command("fly", cls=HeadedCommand)
@click.option("--out", type=PATH, help="The log to write: .csv or .parquet; with --rescue a recording, .rrd.")
@click.option(
    "--live",
    "target",
    metavar="udp:HOST:PORT",
    help="Send the sensor readings as an autopilot does (MAVLink), for `gtmbench live`; --noise is t2 then.",
)
@click.option("--speed", type=float, help="With --live: how many times real time.  [default: 1]")
@aircraft_options
@click.option(
    "--excitation", default="dissertation", show_default=True, help="A name from `gtmbench list`, or a sum of names."
)
@click.option("--duration", default=500.0, show_default=True, help="Seconds to fly.")
@click.option("--seed", default=1, show_default=True, help="Seed of excitation, turbulence and noise.")
@click.option("--noise", help="Write sensor readings with the T2's noise (t2) or a signal-to-noise ratio (50).")
@click.option("--commands", is_flag=True, help="With --noise: also write the surface commands.")
@click.option(
    "--closed-loop", is_flag=True, help="Let the aircraft's autopilot fly on the sensor readings; excitations add."
)
@click.option(
    "--controller",
    metavar="FILE.py:OBJECT",
    help="With --closed-loop: your own controller flies instead of the autopilot, a function command(readings, time_s) "
    "or a class with that method.",
)
@fault_options(
    "A fault of a surface (jam:elevator) is flown. One of a sensor needs --closed-loop, which flies on it, or --live, "
    "which sends it."
)
@click.option(
    "--attitude",
    default="own",
    show_default=True,
    metavar="NAME",
    help="With --closed-loop or --noise: the source of phi, theta and psi. own: a vertical gyro. Or an estimator that "
    "p, q and r drive: 'filter 1 s', 'filter 5 s', 'filter 20 s', kalman.",
)
@click.option(
    "--sensors",
    metavar="ideal|chain",
    help="With --closed-loop or --noise: the way from motion to readings. chain: the aircraft's own delays, "
    "filters and sample rates, and in the loop the gains for them.  [default: chain, where "
    "the aircraft's own autopilot flies and has gains for it; else ideal]",
)
@click.option(
    "--rescue",
    is_flag=True,
    help="Fly a gyro's fault twice in the loop, without accommodation and with it.  [default fault: r's sign flips]",
)
@click.option("--figure", type=PATH, help="With --rescue: also a figure: .png, .svg or .pdf.")
@click.option(
    "--detector",
    "monitor_file",
    type=PATH,
    metavar="MONITOR.json",
    help="With --rescue: a monitor from `gtmbench calibrate`.  [default: bank C-early, calibrated now on 6 flights]",
)
@click.option("--force", is_flag=True, help="Write over an existing file.")
@common_options
def fly_command(
    out: Path | None,
    target: str | None,
    speed: float | None,
    name: str,
    without_io: bool,
    excitation: str,
    duration: float,
    seed: int,
    noise: str | None,
    commands: bool,
    closed_loop: bool,
    controller: str | None,
    given: tuple[str, ...],
    onset: float | None,
    trial: int | None,
    attitude: str,
    sensors: str | None,
    rescue: bool,
    figure: Path | None,
    monitor_file: Path | None,
    force: bool,
    **where: Any,  # altitude and speed
) -> None:
    """Fly a simulated aircraft, and write a log of it: the truth, or with --noise what its sensors read.

    Example: gtmbench fly --out flight.csv --duration 90 --excitation multisine+turbulence --noise t2

    With --live the readings are sent as an autopilot sends them. With --rescue the autopilot flies on the sensor
    readings twice; on the second flight a monitor isolates the broken gyro and takes its reading out of the loop, and
    `gtmbench view FILE.rrd` shows both aircraft beside each other.
    """
    if not rescue:
        refuse({"--figure": figure, "--detector": monitor_file}, "of --rescue; add that, or leave it out")
    else:
        _check_rescue()
        out = Path("rescue.rrd") if out is None else out
        claim_file(out, force=force, ends=[".rrd"])
        claim_file(figure, force=force, option="--figure", ends=[".png", ".svg", ".pdf"])
        faults = chosen_faults(given, onset, trial).faults
        flown = loaded_aircraft(name, without_io=without_io, **where)
        _fly_twice(out, figure, faults, monitor_file, name, flown, seed=seed, sensors=sensors, **where)
        return
    from gtmbench.bench.attitude_filter import estimated_attitude
    from gtmbench.bench.breaking import is_of_surface
    from gtmbench.bench.flight import fly
    from gtmbench.bench.sensor_chain import IDEAL
    from gtmbench.bench.sensors import measure
    from gtmbench.faults.fault import inject
    from gtmbench.imports import load_object
    from gtmbench.report.tables.results import event_rows
    from gtmbench.report.words.events import loop_text
    from gtmbench.values.attitude_estimators import estimator_of

    _check_destination(out, target, speed, force=force)
    noise = noise.lower() if noise else "t2" if target else None
    snr = None if noise in (None, "t2") else _ratio(str(noise))
    estimator_of(attitude)
    # imported before the faults are read: their scenario may name it, too
    flown_by = load_object(controller) if closed_loop and controller is not None else None
    faults = chosen_faults(given, onset, trial).faults
    of_surfaces = [fault for fault in faults if is_of_surface(fault)]
    of_sensors = [fault for fault in faults if not is_of_surface(fault)]
    if not closed_loop:
        _check_open_loop(controller, attitude, noise, breaks=bool(of_sensors) and target is None)
    if closed_loop and snr is not None:
        raise InputError(f"--noise is {snr:g}, but in the loop sensors have the T2's noise; give --noise t2")
    aircraft = loaded_aircraft(name, without_io=without_io, **where)
    sensors = sensors or (aircraft.loop_sensors if closed_loop and controller is None else IDEAL)
    chain = aircraft.chain_of(sensors)
    if chain is not None and noise is None and not closed_loop:
        raise InputError(f"--sensors is '{sensors}', but the truth has no sensors; add --noise t2 or --closed-loop")
    events: tuple[LoopEvent, ...] = ()
    failed: ControllerError | None = None
    if closed_loop:
        how = {"controller": flown_by, "faults": faults, "attitude": attitude, "sensors": sensors, **where}
        flight, failed = _in_loop(aircraft, excitation, duration, seed, **how)
        record, events = flight.truth if noise is None else flight.readings(commands=commands), flight.events
    else:
        record = truth = fly(aircraft, excitation, duration, seed, faults=of_surfaces, **where)
        if noise is not None:
            kind = "t2" if snr is None else None
            readings = measure(truth, snr=snr, noise=kind, seed=seed, commands=commands, sensors=chain)
            record = estimated_attitude(readings, truth, attitude, seed)
            for fault in of_sensors:  # which no loop has flown
                record = inject(record, fault)
    verdict = _deliver(record, out, target, speed)
    if failed is not None:  # what was flown is kept
        raise type(failed)(f"{failed}; {out or target} got the {record.end_s:g} s flown until then") from failed
    to = {"out": None if out is None else str(out), "live": target}
    written = {**to, "samples": len(record), "channels": record.channels, "end_s": record.end_s}
    told = [f"{event.time_s:g} s: {loop_text(event)}" for event in events]
    if closed_loop and noise is None and of_sensors:
        told.append("note: this is the truth, which the broken sensor steered; --noise t2 writes what it read")
    finish(envelope("fly", verdict, written, findings=event_rows(events)), lambda: told)


def _check_rescue() -> None:
    """Refuse what a rescue has its own of: it flies in the loop, as long as it takes."""
    context = click.get_current_context()
    own = ("target", "speed", "excitation", "duration", "noise", "commands", "closed_loop", "controller", "attitude")
    for option in context.command.params:
        if option.name in own and context.get_parameter_source(option.name) is ParameterSource.COMMANDLINE:
            raise InputError(f"{option.opts[0]} isn't of --rescue, which flies in the loop and says how; leave it out")


def _check_open_loop(controller: str | None, attitude: str, noise: str | None, *, breaks: bool) -> None:
    """Refuse what needs --closed-loop, or sensors."""
    from gtmbench.values.attitude_estimators import OWN

    if controller is not None:
        raise InputError(f"--controller is '{controller}', but nobody flies an open loop; add --closed-loop")
    if breaks:
        raise InputError(
            "--fault of a sensor needs --closed-loop or --live; to break an open-loop flight's log, use gtmbench inject"
        )
    if attitude != OWN and noise is None:
        raise InputError(f"--attitude is '{attitude}', but the truth has no estimator; add --noise t2 or --closed-loop")


def _in_loop(*how: Any, **settings: Any) -> tuple[LoopFlight, ControllerError | None]:
    """Fly in the loop; of a controller that fails, return what was flown and the error."""
    from gtmbench.bench.loop import fly_in_loop
    from gtmbench.bench.loop_flight import ControllerError

    try:
        return fly_in_loop(*how, **settings), None
    except ControllerError as error:
        return error.flight, error


def _ratio(text: str) -> float:
    from gtmbench.bench.sensors import SNR_SPAN

    try:
        ratio = float(text)
    except ValueError:
        raise InputError(f"--noise is '{text}'; give t2 or a signal-to-noise ratio such as 50") from None
    return number("--noise", ratio, *SNR_SPAN)


def _check_destination(out: Path | None, target: str | None, speed: float | None, *, force: bool) -> None:
    """Refuse a flight that goes nowhere, and a log or a receiver that can't be one."""
    if out is None and target is None:
        raise InputError("the flight goes nowhere: give --out flight.csv, or --live udp:127.0.0.1:14550 to send it")
    if speed is not None:
        number("--speed", speed, 0.0, 1e4, above=True)
        if target is None:
            raise InputError(f"--speed is {speed:g}, and nothing is sent; add --live udp:127.0.0.1:14550")
    if target is not None:
        from gtmbench.link.sending import udp_address

        udp_address(target)
    if out is not None:
        from gtmbench.files.logs import check_log_path

        check_log_path(out)
        claim_file(out, force=force)


def _deliver(record: Record, out: Path | None, target: str | None, speed: float | None) -> str:
    said = []
    if out is not None:
        from gtmbench.files.logs import write_log

        write_log(record, out)
        said.append(f"Wrote {out}: {len(record)} samples of {len(record.channels)} channels, {record.end_s:g} s.")
    if target is not None:
        from gtmbench.link.sending import send_live

        speed = 1.0 if speed is None else speed
        if not is_silent() and sys.stderr.isatty():
            echo(f"sending {record.end_s:g} s to {target} at {speed:g} times real time; Ctrl-C ends it", err=True)
        send_live(record, target, speed=speed)
        said.append(f"Sent {len(record)} samples of {record.end_s:g} s to {target}.")
    return " ".join(said)


_BEFORE_S = 20.0  # the onset, and after it: a monitor has to come to rest first


def _fly_twice(
    out: Path,
    figure: Path | None,
    faults: tuple[Fault, ...],
    monitor_file: Path | None,
    name: str,
    aircraft: Aircraft,
    *,
    sensors: str | None,
    **how: Any,
) -> None:
    from gtmbench.bench.sensor_chain import IDEAL
    from gtmbench.detectors.accommodation.without_sensor import Accommodate
    from gtmbench.detectors.monitor_file import load_monitor
    from gtmbench.faults.kinds.shaping import SignFlip
    from gtmbench.report.figures.rescue import rescue_figure
    from gtmbench.report.recording.flight import write_rescue_recording
    from gtmbench.report.tables.results import event_rows
    from gtmbench.report.words.study import rescue_verdict
    from gtmbench.study.run import fly_rescue

    faults = faults or (SignFlip(channel="r", onset_s=_BEFORE_S),)
    with shown_progress() as tell:
        kept = load_monitor(monitor_file) if monitor_file else None
        sensors = sensors or (aircraft.loop_sensors if kept is None else str(kept.provenance.get("sensors", IDEAL)))
        aircraft.chain_of(sensors)
        monitor = _calibrated(name, sensors, tell) if kept is None else kept
    onset_s = min(fault.onset_s for fault in faults)
    how |= {"aircraft": aircraft, "sensors": sensors, "duration_s": onset_s + 30.0}
    rescue = fly_rescue(faults, Accommodate(monitor), **how)
    write_rescue_recording(rescue, out)
    if figure is not None:
        with atomic_write(figure) as aside:
            rescue_figure(rescue).savefig(aside, dpi=150)
    told = [{**row, "flight": name} for name, each in rescue.flights.items() for row in event_rows(each.events)]
    own = {"out": str(out), "figure": None if figure is None else str(figure), "onset_s": onset_s}
    result = envelope("fly-rescue", rescue_verdict(rescue), own, findings=told)
    finish(result, lambda: [*_lines(rescue), f"{out}: both flights; gtmbench view {out}"])


def _lines(rescue: Rescue) -> Iterator[str]:
    from gtmbench.report.words.events import loop_text
    from gtmbench.report.words.judgement import fault_text

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

    flights = CalibrationFlights(flights=6, duration_s=200.0, aircraft=aircraft, seed=660_001, sensors=sensors)
    recipe = BankDetector(bank=load_bank("C-early"))  # flights that nobody is rescued on
    records = flights.records(recipe, processes=os.cpu_count() or 1, progress=tell)
    return recipe.calibrate(records, progress=tell)
