"""Aircraft: where they stand, what is known of them, and a JSBSim engine with one loaded."""

from __future__ import annotations

import ctypes
import io
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, redirect_stdout
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any
from xml.parsers import expat

import jsbsim

from gtmbench.channels import CHANNELS, COMMANDS
from gtmbench.checks import number, one_line, shown, text
from gtmbench.errors import GtmbenchError, InputError
from gtmbench.files import check_size, is_file, read_toml
from gtmbench.record import Span
from gtmbench.shipped import share, shipped_aircraft

SAMPLE_PERIOD_S = 0.01
UNKNOWNS = ("alpha", "phi", *COMMANDS)  # what trim solves for
_ADAMS_BASHFORTH_2 = 3
_LARGEST_MODEL_BYTES = 20_000_000
_DEEPEST = 100  # elements in elements: JSBSim's reader calls itself
_REACH_OUT = ("input", "output")  # JSBSim would write files anywhere, listen on ports and connect to hosts


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

    @property
    def searched(self) -> dict[str, Span]:
        """Where trim looks for its unknowns."""
        return {"alpha": self.envelope["alpha"], "phi": (-60.0, 60.0), **{name: self.limits[name] for name in COMMANDS}}


def load_aircraft(name: str | Path) -> Aircraft:
    """Return an aircraft by name (one of the package's) or by the path of its folder.

    Raises
    ------
    InputError
        Where there is no such aircraft or its ``aircraft.toml`` is incomplete.
    """
    shipped = shipped_aircraft()
    folder = share() / "aircraft" / name if str(name) in shipped else Path(os.path.realpath(name))
    path = folder / "aircraft.toml"
    if not is_file(path):
        raise InputError(f"no aircraft {shown(str(name))}; there are {', '.join(shipped)}, or give a folder's path")
    facts = read_toml(path, "aircraft")
    try:
        return _aircraft(folder, facts)
    except InputError as error:
        raise InputError(f"{path}: {error}; see the GTM's for every key") from error


def _aircraft(folder: Path, facts: dict[str, Any]) -> Aircraft:
    trim, limits, envelope = (_table(facts, key) for key in ("trim", "limits", "envelope"))
    guess = _table(trim, "guess")
    for table, wanted, given in (
        ("trim", ("altitude_ft", "tas_kt", "psi_deg", "latitude_deg"), trim),
        ("trim.guess", UNKNOWNS, guess),
        ("limits", COMMANDS, limits),
        ("envelope", ("alpha", "altitude"), envelope),
    ):
        if missing := sorted(set(wanted) - given.keys()):
            raise InputError(f"[{table}] lacks {', '.join(missing)}")
    if unknown := envelope.keys() - CHANNELS.keys():
        raise InputError(f"[envelope] names no channel: {', '.join(sorted(unknown))}")
    aircraft = Aircraft(
        name=text("the folder's name", folder.name),
        title=text("title", facts.get("title")),
        folder=folder,
        altitude_ft=number("trim.altitude_ft", trim["altitude_ft"], -1e6, 1e6),
        tas_kt=number("trim.tas_kt", trim["tas_kt"], 0.0, 2000.0, above=True),
        psi_deg=number("trim.psi_deg", trim["psi_deg"], -360.0, 360.0),
        latitude_deg=number("trim.latitude_deg", trim["latitude_deg"], -90.0, 90.0),
        guess={key: number(f"trim.guess.{key}", guess[key]) for key in UNKNOWNS},
        limits={key: _span(f"limits.{key}", limits[key]) for key in COMMANDS},
        envelope={key: _span(f"envelope.{key}", value) for key, value in envelope.items()},
    )
    for key, (low, high) in aircraft.searched.items():
        if not low <= aircraft.guess[key] <= high:
            raise InputError(f"trim.guess.{key} is {aircraft.guess[key]:g}; it must lie in {low:g}..{high:g}")
    return aircraft


def _table(facts: dict[str, Any], key: str) -> dict[str, Any]:
    if not isinstance(facts.get(key), dict):
        raise InputError(f"{key} is {shown(facts.get(key))}; it must be a table")
    return dict(facts[key])


def _span(name: str, value: Any) -> Span:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"{name} is {shown(value)}; it must be two numbers, [low, high]")
    low, high = (number(name, bound) for bound in value)
    if not low < high:
        raise InputError(f"{name} is {shown(value)}; the first must be less than the second")
    return low, high


@contextmanager
def silenced() -> Iterator[io.StringIO]:
    """Give what JSBSim prints, which is kept off stdout; not in threads, for stdout is everybody's."""
    printed = io.StringIO()
    with redirect_stdout(printed) if threading.current_thread() is threading.main_thread() else nullcontext():
        yield printed


@contextmanager
def simulating(fdm: jsbsim.FGFDMExec, aircraft: Aircraft) -> Iterator[None]:
    """Turn what JSBSim throws into an error of ours.

    An engine that has failed is never destroyed: its destructor throws the same again, and that ends the process.
    """
    try:
        yield
    except RuntimeError as error:  # JSBSim's own errors are among these
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(fdm))
        raise GtmbenchError(f"JSBSim can't fly '{aircraft.name}' of {aircraft.folder}: {error}") from error


def engine(aircraft: Aircraft) -> jsbsim.FGFDMExec:
    """Return a fresh JSBSim instance with the aircraft loaded, at 100 Hz.

    Fresh, because an instance that has flown before gives another flight for the same turbulence seed.

    Raises
    ------
    GtmbenchError
        Where JSBSim can't load the model.
    """
    model = aircraft.folder / f"{aircraft.name}.xml"
    check_model(model)
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
    with simulating(fdm, aircraft), silenced() as printed:
        loaded = fdm.load_model(aircraft.name)
    if not loaded:
        raise GtmbenchError(f"JSBSim can't load {model}: {one_line(printed.getvalue()) or 'it says no more'}")
    fdm.disable_output()
    properties = fdm.get_property_manager()
    for channel in CHANNELS.values():
        if properties.get_node(channel.jsbsim) is None:
            raise GtmbenchError(f"{model} has no property '{channel.jsbsim}', which channel '{channel.name}' needs")
    return fdm


def check_model(path: Path) -> None:
    """Refuse a model, and what it includes from its folder, that isn't whole or reaches outside.

    Raises
    ------
    InputError
        Naming the file and what is wrong with it.
    """
    if not is_file(path):
        raise InputError(f"{path}: no such file; an aircraft's folder NAME holds its model, NAME.xml")
    for name in _checked(path):
        if {"/", ".."}.intersection(PurePosixPath(name.replace("\\", "/")).parts):
            raise InputError(f"{path} includes '{name}'; a model's parts stand in its own folder")
        part = path.parent / name
        part = part if part.suffix == ".xml" else Path(f"{part}.xml")
        if part.exists():
            if not is_file(part):
                raise InputError(f"{path} includes {part}, which isn't a file")
            _checked(part)


def _checked(path: Path) -> list[str]:
    """Return the names of the files that a file includes."""
    open_elements: list[str] = []
    included: list[str] = []

    def begin(name: str, attributes: dict[str, str]) -> None:
        if len(open_elements) == 1 and name in _REACH_OUT:
            raise InputError(f"{path} has an <{name}> section, which would reach outside (files, ports); take it out")
        open_elements.append(name)
        if len(open_elements) > _DEEPEST:
            raise InputError(f"{path} has elements in elements, more than {_DEEPEST} deep; no model needs that")
        if "file" in attributes:
            included.append(attributes["file"])

    def end(_: str) -> None:
        open_elements.pop()

    def declares(*_: Any) -> None:
        raise InputError(f"{path} declares a document type; a model needs no entities, take it out")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler = declares
    check_size(path, "model", _LARGEST_MODEL_BYTES)
    try:
        parser.Parse(path.read_bytes(), True)
    except InputError:
        raise
    except (expat.ExpatError, LookupError, ValueError) as error:  # the last two: an encoding that nobody knows
        raise InputError(f"{path} isn't whole XML: {error}") from error
    return included
