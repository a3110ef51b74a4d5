"""What commands do alike with aircraft: options, what is said of a model, a file of facts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gtmbench.cli.output import F, echo
from gtmbench.files.shipped import shipped_aircraft

if TYPE_CHECKING:
    from gtmbench.bench.aircraft import Aircraft


def aircraft_options(command: F) -> F:
    """Add what says which aircraft, and where it flies: ``name``, ``altitude``, ``tas``, ``without_io``."""
    for option in (
        click.option("--without-io", is_flag=True, help="Leave out the model's input and output sections."),
        click.option("--tas", type=float, help="True airspeed in kt.  [default: the aircraft's own]"),
        click.option("--altitude", type=float, help="Altitude in ft.  [default: the aircraft's own]"),
        click.option(
            "--aircraft",
            "name",
            default="gtm",
            show_default=True,
            help="A name from `gtmbench list --all`, or an aircraft's folder.",
        ),
    ):
        command = option(command)
    return command


def told_aircraft(name: str, *, altitude: float | None, tas: float | None, without_io: bool, silent: bool) -> Aircraft:
    """Load an aircraft; say what of its model is left out, and where its condition seems to be in other units."""
    from gtmbench.bench.equilibrium import mistaken_units
    from gtmbench.bench.known_aircraft import load_aircraft
    from gtmbench.bench.model_file import check_model

    aircraft = load_aircraft(name, without_io=without_io)
    if not silent and aircraft.without_io and (left_out := sorted(set(check_model(aircraft.model)))):
        what = " and ".join(f"<{section}>" for section in left_out)
        echo(f"note: {aircraft.name} flies without the {what} of its model, which would open ports or files", err=True)
    if not silent and (said := mistaken_units(aircraft, altitude_ft=altitude, tas_kt=tas)):
        echo(f"note: {said}", err=True)
    return aircraft


def at_condition(aircraft: Aircraft, *, altitude_ft: float | None, tas_kt: float | None) -> Aircraft:
    """Return an aircraft that is trimmed at another condition where one is given."""
    altitude_ft = aircraft.altitude_ft if altitude_ft is None else altitude_ft
    return replace(aircraft, altitude_ft=altitude_ft, tas_kt=aircraft.tas_kt if tas_kt is None else tas_kt)


def aircraft_file(name: str, folder: Path | None, *, without_io: bool) -> tuple[Path, str]:
    """Return where an aircraft's facts go, by default into its own folder if that is the user's, and their text.

    Raises
    ------
    InputError
        Where there is no such aircraft.
    """
    from gtmbench.bench.aircraft import facts_of
    from gtmbench.bench.aircraft_file import commented
    from gtmbench.bench.known_aircraft import FACTS, jsbsim_aircraft, load_aircraft, model_folder

    craft = load_aircraft(name, without_io=without_io)
    own = craft.folder
    is_known = own.name in (*shipped_aircraft(), *jsbsim_aircraft()) and model_folder(own.name) == own
    folder = folder or (Path(f"my-{own.name}") if is_known else own)
    model = None if folder.resolve() == own else own.name if is_known else str(own)
    return folder / FACTS, commented(facts_of(craft), model)
