"""``gtmbench aircraft``: trim, modes, gains and facts of an aircraft; and what commands do alike with aircraft."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.cli.output import (
    PATH,
    F,
    HeadedCommand,
    claim_file,
    common_options,
    echo,
    finish,
    is_silent,
    print_table,
    shown_progress,
    write_new,
)
from gtmbench.errors import InputError
from gtmbench.files.plain import envelope
from gtmbench.files.shipped import shipped_aircraft
from gtmbench.files.writing import write_text

if TYPE_CHECKING:
    from gtmbench.bench.aircraft import Aircraft
    from gtmbench.bench.autopilot import Trim
    from gtmbench.bench.modes import Mode


def condition_options(command: F) -> F:
    """Add what says where an aircraft flies: ``altitude_ft``, ``tas_kt``, ``without_io``."""
    own = "[default: the aircraft's own]"
    told = "Leave out the model's input and output sections."
    command = click.option("--without-io", is_flag=True, help=told)(command)
    command = click.option("--tas", "tas_kt", type=float, help=f"True airspeed in kt.  {own}")(command)
    return click.option("--altitude", "altitude_ft", type=float, help=f"Altitude in ft.  {own}")(command)


def aircraft_options(command: F) -> F:
    """Add what says which aircraft, and where it flies: ``name``, and what `condition_options` add."""
    return click.option(
        "--aircraft",
        "name",
        default="gtm",
        show_default=True,
        help="A name from `gtmbench list --all`, or an aircraft's folder.",
    )(condition_options(command))


def loaded_aircraft(name: str, *, without_io: bool, **where: float | None) -> Aircraft:
    """Load an aircraft; say what of its model is left out, and where its condition seems to be in other units."""
    from gtmbench.bench.engine import check_model
    from gtmbench.bench.equilibrium import mistaken_units
    from gtmbench.bench.known_aircraft import load_aircraft

    aircraft = load_aircraft(name, without_io=without_io)
    if is_silent():
        return aircraft
    if aircraft.without_io and (left_out := sorted(set(check_model(aircraft.model)))):
        what = " and ".join(f"<{section}>" for section in left_out)
        echo(f"note: {aircraft.name} flies without the {what} of its model, which would open ports or files", err=True)
    if said := mistaken_units(aircraft, **where):
        echo(f"note: {said}", err=True)
    return aircraft


def _facts_file(name: str, folder: Path | None, *, without_io: bool) -> tuple[Path, str]:
    """Return where an aircraft's facts go, by default into its own folder if that is the user's, and their text."""
    from gtmbench.bench.aircraft import commented, facts_of
    from gtmbench.bench.known_aircraft import FACTS, jsbsim_aircraft, load_aircraft, model_folder

    craft = load_aircraft(name, without_io=without_io)
    own = craft.folder
    is_known = own.name in (*shipped_aircraft(), *jsbsim_aircraft()) and model_folder(own.name) == own
    folder = folder or (Path(f"my-{own.name}") if is_known else own)
    model = None if folder.resolve() == own else own.name if is_known else str(own)
    return folder / FACTS, commented(facts_of(craft), model)


@click.command("aircraft", cls=HeadedCommand)
@click.argument("name", default="gtm", metavar="[NAME|FOLDER]")
@condition_options
@click.option("--modes", "with_modes", is_flag=True, help="Also print the linear modes: natural frequency and damping.")
@click.option(
    "--autopilot",
    "finds_gains",
    is_flag=True,
    help="Find gains of an autopilot that holds the aircraft in turbulence, by flying it; it takes seconds.",
)
@click.option(
    "--sensors",
    default="ideal",
    show_default=True,
    metavar="ideal|chain",
    help="With --autopilot: find gains on the aircraft's own sensor chain; they go into [chain_autopilot].",
)
@click.option(
    "--facts",
    "writes_facts",
    is_flag=True,
    help="Write what is known of it as aircraft.toml, commented, to be edited: into --out, or its own folder.",
)
@click.option(
    "--out", type=PATH, help="With --autopilot: also write its table into this file. With --facts: the folder."
)
@click.option("--force", is_flag=True, help="Write over an existing file of --autopilot.")
@common_options
def aircraft_command(
    name: str,
    without_io: bool,
    with_modes: bool,
    finds_gains: bool,
    sensors: str,
    writes_facts: bool,
    out: Path | None,
    force: bool,
    **where: Any,  # altitude and speed
) -> None:
    """Trim an aircraft for level flight; also find gains of an autopilot for it, or write down what is known of it.

    Example: gtmbench aircraft c172p --modes

    NAME is one of `gtmbench list --all`, or the folder of a JSBSim model (docs/how_to/aircraft.md). The gains of
    --autopilot are a table for its aircraft.toml or for a scenario; then `gtmbench fly --closed-loop` and `gtmbench
    run` fly in the loop.
    """
    if finds_gains and writes_facts:
        raise InputError("--autopilot and --facts are both given; write the facts first, then find the gains")
    if out is not None and not (finds_gains or writes_facts):
        raise InputError(f"--out is '{out}', and a trim is only printed; add --autopilot or --facts")
    if writes_facts:
        _write_facts(name, out, without_io=without_io)
        return
    if finds_gains:
        claim_file(out, force=force)
    aircraft = loaded_aircraft(name, without_io=without_io, **where)
    if finds_gains:
        told = {key: value for key, value in where.items() if value is not None}
        _find_gains(replace(aircraft, **told), sensors, out)
    else:
        _trim(aircraft, where, with_modes=with_modes)


def _write_facts(name: str, folder: Path | None, *, without_io: bool) -> None:
    target, text = _facts_file(name, folder, without_io=without_io)
    target.parent.mkdir(exist_ok=True)
    write_new(target, text)
    verdict = f"Wrote {target}; edit it, then run: gtmbench aircraft {target.parent}"
    finish(envelope("aircraft-facts", verdict, {"out": str(target)}))


def _trim(aircraft: Aircraft, where: Mapping[str, Any], *, with_modes: bool) -> None:
    from gtmbench.bench.flight import trim
    from gtmbench.bench.modes import modes

    trimmed = trim(aircraft, **where)
    linear = modes(aircraft, **where) if with_modes else None
    verdict = (
        f"{aircraft.name} flies level at {trimmed.altitude_ft:.0f} ft and {trimmed.tas_kt:.1f} kt true airspeed with "
        f"alpha {trimmed.alpha_deg:.2f} deg, throttle {trimmed.throttle_percent:.1f} %."
    )

    def rest() -> None:
        echo(_trim_text(trimmed))
        if linear:
            _print_modes(linear)

    finish(envelope("aircraft", verdict, {"trim": trimmed, "modes": linear or []}), rest)


def _trim_text(state: Trim) -> str:
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


def _find_gains(aircraft: Aircraft, sensors: str, out: Path | None) -> None:
    from gtmbench.bench.aircraft import autopilot_table
    from gtmbench.bench.tuning import find_autopilot

    aircraft.chain_of(sensors)
    with shown_progress() as tell:
        tuned = find_autopilot(aircraft, sensors=sensors, progress=tell)
    text = autopilot_table(asdict(tuned.autopilot), "autopilot" if sensors == "ideal" else "chain_autopilot")
    if out is not None:
        write_text(out, text)
    verdict = (
        f"Found gains for {aircraft.name}: in ten minutes of moderate turbulence altitude stays within "
        f"{tuned.altitude_off_ft:.0f} ft, speed within {tuned.tas_off_kt:.0f} kt, bank within {tuned.bank_deg:.1f} deg."
    )

    def rest() -> Iterator[str]:
        rates = ", ".join(f"{name} {rms:.2f}" for name, rms in tuned.rates_deg_s.items())
        yield f"rates, RMS: {rates} deg/s; all gyros and angles may come {1e3 * tuned.delay_margin_s:.0f} ms later"
        if not tuned.autopilot.r_to_rudder_s:
            yield "no yaw damper: nothing answers the rudder"
        yield text.rstrip()
        yield f"put it into the aircraft.toml of '{aircraft.name}', or into a scenario" + (f": {out}" if out else "")

    own = {"out": None if out is None else str(out), **asdict(tuned)}
    finish(envelope("aircraft-autopilot", verdict, own), rest)
