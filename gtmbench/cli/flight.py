"""Commands of the bench: trim, fly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import number
from gtmbench.cli.aircraft import aircraft_options, told_aircraft
from gtmbench.cli.faults import chosen_faults, fault_options
from gtmbench.cli.output import common_options, echo, print_json, print_table
from gtmbench.cli.sending import broken, check_destination, deliver
from gtmbench.errors import InputError
from gtmbench.report.tables.envelope import envelope

if TYPE_CHECKING:
    from gtmbench.bench.loop_flight import ControllerError, LoopEvent, LoopFlight
    from gtmbench.bench.modes import Mode
    from gtmbench.bench.trim import Trim


@click.command("trim")
@aircraft_options
@click.option("--modes", "with_modes", is_flag=True, help="Also print the linear modes: natural frequency and damping.")
@common_options
def trim_command(
    name: str,
    altitude: float | None,
    tas: float | None,
    without_io: bool,
    with_modes: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Trim an aircraft for level flight and print it as the dissertation does."""
    from gtmbench.bench.modes import modes
    from gtmbench.bench.trimming import trim

    aircraft = told_aircraft(name, altitude=altitude, tas=tas, without_io=without_io, silent=as_json or quiet)
    trimmed = trim(aircraft, altitude_ft=altitude, tas_kt=tas)
    linear = modes(aircraft, altitude_ft=altitude, tas_kt=tas) if with_modes else None
    verdict = (
        f"{aircraft.name} flies level at {trimmed.altitude_ft:.0f} ft and {trimmed.tas_kt:.1f} kt true airspeed with "
        f"alpha {trimmed.alpha_deg:.2f} deg, throttle {trimmed.throttle_percent:.1f} %."
    )
    if as_json:
        own = {"trim": asdict(trimmed), "modes": [asdict(mode) for mode in linear or []]}
        print_json(envelope("trim", verdict, own))
    elif not quiet:
        echo(verdict)
        echo(trim_text(trimmed))
        if linear:
            _print_modes(linear)


def trim_text(state: Trim) -> str:
    """Write a trim as section 4.4 prints it."""
    return (
        f"Level flight, altitude = {state.altitude_ft:.2f} ft, equivalent airspeed = {state.eas_kt:.2f} kt, "
        f"true airspeed = {state.tas_kt:.2f} kt,\nalpha = {state.alpha_deg:.2f} deg, beta = {state.beta_deg:.2f} deg, "
        f"gamma = {state.gamma_deg:.2f} deg, roll = {state.roll_deg:.3f} deg, pitch = {state.pitch_deg:.2f} deg,\n"
        f"yaw = {state.yaw_deg:.2f} deg, ground track = {state.ground_track_deg:.2f} deg, "
        f"elevator = {state.elevator_deg:.2f} deg, aileron = {state.aileron_deg:.3f} deg, "
        f"rudder = {state.rudder_deg:.3f} deg, throttle = {state.throttle_percent:.2f} %"
    )


def _print_modes(linear: list[Mode]) -> None:
    rows = [
        [
            mode.name,
            f"{mode.real_1_s:.4f}" + (f" ± {mode.imag_1_s:.4f} i" if mode.imag_1_s else ""),
            f"{mode.natural_frequency_rad_s:.4f}",
            f"{mode.damping:.4f}",
            f"{mode.time_constant_s:.3f}",
        ]
        for mode in linear
    ]
    names = ["mode", "eigenvalue (1/s)", "natural frequency (rad/s)", "damping", "time constant (s)"]
    print_table("Linear modes", names, rows, right=names[1:])


@click.command("fly")
@click.option("--out", type=click.Path(path_type=Path), help="The log to write: .csv or .parquet.")
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
@click.option("--force", is_flag=True, help="Write over an existing file.")
@common_options
def fly_command(
    out: Path | None,
    target: str | None,
    speed: float | None,
    name: str,
    altitude: float | None,
    tas: float | None,
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
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Fly and write a log of the truth, or with --noise of the sensor readings; or send these live."""
    from gtmbench.bench.attitude_filter import estimated_attitude
    from gtmbench.bench.breaking import is_of_surface
    from gtmbench.bench.flight import fly
    from gtmbench.bench.sensor_chain import IDEAL
    from gtmbench.bench.sensors import measure
    from gtmbench.imports import load_object
    from gtmbench.report.tables.loop import event_rows
    from gtmbench.values.attitude import estimator_of

    check_destination(out, target, speed, force=force)
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
    aircraft = told_aircraft(name, altitude=altitude, tas=tas, without_io=without_io, silent=as_json or quiet)
    sensors = sensors or (aircraft.loop_sensors if closed_loop and controller is None else IDEAL)
    chain = aircraft.chain_of(sensors)
    if chain is not None and noise is None and not closed_loop:
        raise InputError(f"--sensors is '{sensors}', but the truth has no sensors; add --noise t2 or --closed-loop")
    events: tuple[LoopEvent, ...] = ()
    failed: ControllerError | None = None
    if closed_loop:
        flight, failed = _in_loop(
            aircraft,
            excitation,
            duration,
            seed,
            controller=flown_by,
            faults=faults,
            attitude=attitude,
            sensors=sensors,
            altitude_ft=altitude,
            tas_kt=tas,
        )
        record, events = flight.truth if noise is None else flight.readings(commands=commands), flight.events
    else:
        record = truth = fly(aircraft, excitation, duration, seed, faults=of_surfaces, altitude_ft=altitude, tas_kt=tas)
        if noise is not None:
            kind = "t2" if snr is None else None
            readings = measure(truth, snr=snr, noise=kind, seed=seed, commands=commands, sensors=chain)
            record = broken(estimated_attitude(readings, truth, attitude, seed), of_sensors)
    verdict = deliver(record, out, target, speed, silent=as_json or quiet)
    if failed is not None:  # what was flown is kept
        where = out or target
        raise type(failed)(f"{failed}; {where} got the {record.end_s:g} s flown until then") from failed
    if as_json:
        to = {"out": None if out is None else str(out), "live": target}
        written = {**to, "samples": len(record), "channels": list(record.channels), "end_s": record.end_s}
        print_json(envelope("fly", verdict, written, findings=event_rows(events)))
    elif not quiet:
        _tell(verdict, events, steered=closed_loop and noise is None and bool(of_sensors))


def _check_open_loop(controller: str | None, attitude: str, noise: str | None, *, breaks: bool) -> None:
    """Refuse what needs --closed-loop, or sensors."""
    from gtmbench.values.attitude import OWN

    if controller is not None:
        raise InputError(f"--controller is '{controller}', but nobody flies an open loop; add --closed-loop")
    if breaks:
        raise InputError(
            "--fault of a sensor needs --closed-loop or --live; to break an open-loop flight's log, use gtmbench inject"
        )
    if attitude != OWN and noise is None:
        raise InputError(f"--attitude is '{attitude}', but the truth has no estimator; add --noise t2 or --closed-loop")


def _tell(verdict: str, events: Sequence[LoopEvent], *, steered: bool) -> None:
    """Print what was written and what happened, and that a broken sensor's readings aren't in the truth it steered."""
    from gtmbench.report.words.judgement import loop_text

    echo(verdict)
    for event in events:
        echo(f"{event.time_s:g} s: {loop_text(event)}")
    if steered:
        echo("note: this is the truth, which the broken sensor steered; --noise t2 writes what it read")


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
