"""Aircraft: where they stand, what is known of them, and a JSBSim engine with one loaded."""

from __future__ import annotations

import os
import tomllib
from dataclasses import dataclass
from pathlib import Path

import jsbsim

from gtmbench.channels import CHANNELS, COMMANDS
from gtmbench.errors import GtmbenchError, InputError
from gtmbench.files import share, shipped_aircraft
from gtmbench.record import Span

SAMPLE_PERIOD_S = 0.01
UNKNOWNS = ("alpha", "phi", *COMMANDS)  # what trim solves for
_ADAMS_BASHFORTH_2 = 3


@dataclass(frozen=True, kw_only=True)
class Aircraft:
    """One aircraft: its folder (with ``NAME/NAME.xml`` and ``NAME/aircraft.toml``) and the facts of the latter.

    ``limits`` bound the commands and ``envelope`` the flight, by channel, in the channel's unit.
    """

    name: str
    title: str
    folder: Path
    altitude_ft: float
    tas_kt: float
    psi_deg: float
    latitude_deg: float
    guess: dict[str, float]
    limits: dict[str, Span]
    envelope: dict[str, Span]


def load_aircraft(name: str | Path) -> Aircraft:
    """Return an aircraft by name (one of the package's) or by the path of its folder.

    Raises
    ------
    InputError
        Where there is no such aircraft or its ``aircraft.toml`` is incomplete.
    """
    shipped = shipped_aircraft()
    folder = share() / "aircraft" / name if str(name) in shipped else Path(name).resolve()
    path = folder / "aircraft.toml"
    if not path.is_file():
        raise InputError(f"no aircraft '{name}'; there are {', '.join(shipped)}, or give a folder's path")
    try:
        facts = tomllib.loads(path.read_text())
        trim = facts["trim"]
        found = Aircraft(
            name=folder.name,
            title=facts["title"],
            folder=folder,
            altitude_ft=float(trim["altitude_ft"]),
            tas_kt=float(trim["tas_kt"]),
            psi_deg=float(trim["psi_deg"]),
            latitude_deg=float(trim["latitude_deg"]),
            guess={key: float(value) for key, value in trim["guess"].items()},
            limits={key: _span(value) for key, value in facts["limits"].items()},
            envelope={key: _span(value) for key, value in facts["envelope"].items()},
        )
    except (tomllib.TOMLDecodeError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path} is incomplete or malformed: {error!r}; see the GTM's for every key") from error
    for table, wanted, given in (
        ("trim.guess", UNKNOWNS, set(found.guess)),
        ("limits", COMMANDS, set(found.limits)),
        ("envelope", ("alpha", "altitude"), set(found.envelope)),
    ):
        if missing := set(wanted) - given:
            raise InputError(f"{path}: [{table}] lacks {', '.join(sorted(missing))}; see the GTM's for every key")
    if unknown := found.envelope.keys() - CHANNELS.keys():
        raise InputError(f"{path}: [envelope] names no channel: {', '.join(sorted(unknown))}")
    return found


def _span(value: list[float]) -> Span:
    low, high = value
    return float(low), float(high)


def engine(aircraft: Aircraft) -> jsbsim.FGFDMExec:
    """Return a fresh JSBSim instance with the aircraft loaded, at 100 Hz.

    Fresh, because an instance that has flown before gives another flight for the same turbulence seed.

    Raises
    ------
    GtmbenchError
        Where JSBSim can't load the model; it prints why.
    """
    # Keeps JSBSim's banner off the terminal. A logger of ours would do that, too, but JSBSim drops it when a thread
    # ends, without Python's lock, and takes the process with it.
    os.environ.setdefault("JSBSIM_DEBUG", "0")
    fdm = jsbsim.FGFDMExec(str(aircraft.folder.parent.parent))
    fdm.set_output_path(str(aircraft.folder))
    fdm.set_aircraft_path(str(aircraft.folder.parent))
    for integrator in ("rate", "position"):
        # JSBSim integrates rotation by rectangles unless told: that is 2 to 3 % of the GTM's yaw rate at 100 Hz
        fdm[f"simulation/integrator/{integrator}/rotational"] = _ADAMS_BASHFORTH_2
    fdm.set_dt(SAMPLE_PERIOD_S)  # components take it over when they load: before load_model
    model = f"{aircraft.folder / aircraft.name}.xml"
    try:
        loaded = fdm.load_model(aircraft.name)
    except jsbsim.BaseError as error:
        raise GtmbenchError(f"JSBSim can't load {model}: {error}") from error
    if not loaded:
        raise GtmbenchError(f"JSBSim can't load {model}, for the reason it printed")
    fdm.disable_output()
    properties = fdm.get_property_manager()
    for channel in CHANNELS.values():
        if properties.get_node(channel.jsbsim) is None:
            raise GtmbenchError(f"{model} has no property '{channel.jsbsim}', which channel '{channel.name}' needs")
    return fdm
