"""A JSBSim engine with an aircraft loaded: made, told its initial condition, commanded; its motors in steady flight.

JSBSim looks for the steady speed of a propeller by steps of half a second, from standstill on, where its torque is the
engine's power over 0.01 rad/s. A small propeller's inertia is so little that the first step throws it to millions of
revolutions, and the next one back to none: it stands, and its torque turns the aircraft by 1e5 rad/s2.

Here the aircraft is held while the propeller turns, w' = f(w), by steps h that are found as it goes: w + h f(w) with
h = -1/f'(w) is Newton's method, and JSBSim itself takes the step.

The governor of a propeller turns its blades by one degree a second for every revolution a minute that is missing, a
turbine spools up over seconds, and neither follows steps of half a second: the blades are left at a stop, or the engine
dies. `settle` runs them at the step that they are flown with, the aircraft held, until their thrust doesn't change.

Of a model's files is refused what isn't whole or leads out of their folder; a copy goes without what reaches outside.
"""

from __future__ import annotations

import ctypes
import io
import math
import os
import shutil
import tempfile
import threading
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, redirect_stdout
from itertools import count
from pathlib import Path, PurePosixPath
from typing import Any
from xml.parsers import expat

import jsbsim
import numpy as np

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S, Aircraft
from gtmbench.checks import one_line
from gtmbench.errors import GtmbenchError, InputError
from gtmbench.files.writing import check_size, is_file
from gtmbench.values.channels import CHANNELS, COMMANDS, GYROS, Role

# The six accelerations that vanish in trim, with what each is driven by.
ACCELERATIONS = {
    "accelerations/udot-ft_sec2": "forward acceleration (thrust against drag)",
    "accelerations/vdot-ft_sec2": "sideward acceleration (side force against bank)",
    "accelerations/wdot-ft_sec2": "downward acceleration (lift against weight)",
    "accelerations/pdot-rad_sec2": "roll acceleration (ailerons)",
    "accelerations/qdot-rad_sec2": "pitch acceleration (elevator)",
    "accelerations/rdot-rad_sec2": "yaw acceleration (rudder)",
}
_RUNNING = "propulsion/engine[{}]/set-running"
_ALL_RUN = ("propulsion/set-running", -1)
# How often initial conditions are taken over before one gives up waiting for servos, filters and propellers to stand
_STANDS = 1e-10  # ft/s2 and rad/s2


@contextmanager
def silenced() -> Iterator[io.StringIO]:
    """Give what JSBSim prints, which is kept off stdout; not in threads, for stdout is everybody's."""
    printed = io.StringIO()
    with redirect_stdout(printed) if threading.current_thread() is threading.main_thread() else nullcontext():
        yield printed


@contextmanager
def simulating(fdm: jsbsim.FGFDMExec, aircraft: Aircraft) -> Iterator[None]:
    """Turn what JSBSim throws into an error of ours."""
    try:
        yield
    except RuntimeError as error:  # JSBSim's own errors are among these
        raise failure(fdm, aircraft, error) from error


def failure(fdm: jsbsim.FGFDMExec, aircraft: Aircraft, error: RuntimeError) -> GtmbenchError:
    """Return our error for one of JSBSim's.

    An engine that has failed is never destroyed: its destructor throws the same again, and that ends the process.
    """
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(fdm))
    return GtmbenchError(f"JSBSim can't fly '{aircraft.name}' of {aircraft.folder}: {error}")


def engine(aircraft: Aircraft) -> jsbsim.FGFDMExec:
    """Return a fresh JSBSim instance with the aircraft loaded, at 100 Hz.

    Fresh, because an instance that has flown before gives another flight for the same turbulence seed.
    """
    # Keeps JSBSim's banner off the terminal. A logger of ours would do that, too, but JSBSim drops it when a thread
    # ends, without Python's lock, and takes the process with it.
    os.environ.setdefault("JSBSIM_DEBUG", "0")
    own = aircraft.folder.parent.parent
    fdm = jsbsim.FGFDMExec(str(own))
    fdm.set_output_path(str(aircraft.folder))
    if not (own / "engine").is_dir():  # motors and propellers of JSBSim's, unless there are others beside the aircraft
        fdm.set_engine_path(str(Path(jsbsim.get_default_root_dir()) / "engine"))
    for integrator in ("rate", "position"):
        # JSBSim integrates rotation by rectangles unless told: that is 2 to 3 % of the GTM's yaw rate at 100 Hz
        fdm[f"simulation/integrator/{integrator}/rotational"] = 3  # Adams-Bashforth 2, of JSBSim's integrators
    fdm.set_dt(SAMPLE_PERIOD_S / aircraft.steps_a_sample)  # components take it over when they load: before load_model
    model = aircraft.model
    with loadable(model, without_io=aircraft.without_io) as file:
        fdm.set_aircraft_path(str(file.parent.parent))
        with simulating(fdm, aircraft), silenced() as printed:
            loaded = fdm.load_model(aircraft.name)
    if not loaded:
        told = one_line(printed.getvalue().replace(str(file), str(model)))  # not where a copy without sections lay
        raise GtmbenchError(f"JSBSim can't load {model}: {told or 'it says no more'}")
    fdm.disable_output()
    with simulating(fdm, aircraft):
        for name, value in aircraft.properties.items():
            fdm[name] = value
    properties = fdm.get_property_manager()
    needed = {channel.name: channel.jsbsim for channel in CHANNELS.values() if channel.role is not Role.COMMAND}
    needed |= {name: command.property for name, command in aircraft.commands.items()}
    if aircraft.motorless:
        del needed["throttle"]
    for name, jsbsims in needed.items():
        if properties.get_node(jsbsims) is None:
            gliding = name == "throttle" and not fdm.get_propulsion().get_num_engines()
            why = "; it has no <propulsion>: if it glides, motorless = true in its aircraft.toml" if gliding else ""
            raise GtmbenchError(f"{model} has no property '{jsbsims}', which channel '{name}' needs{why}")
    return fdm


def set_condition(fdm: jsbsim.FGFDMExec, aircraft: Aircraft, wanted: dict[str, float]) -> None:
    """Put an engine at a condition: angles in deg, speed in kt, body rates in deg/s, commands in their units."""
    fdm["ic/lat-geod-deg"] = aircraft.latitude_deg
    fdm["ic/long-gc-deg"] = 0.0
    fdm["ic/h-sl-ft"] = wanted["altitude"]
    fdm["ic/vt-kts"] = wanted["tas"]
    # JSBSim turns the attitude when alpha or beta are set, but keeps these when the attitude is: so it comes last, and
    # what the engine stood in before leaves no trace
    fdm["ic/alpha-deg"] = wanted["alpha"]
    fdm["ic/beta-deg"] = wanted["beta"]
    fdm["ic/psi-true-deg"] = wanted["psi"]
    fdm["ic/phi-deg"] = wanted["phi"]
    fdm["ic/theta-deg"] = wanted["theta"]
    for rate in GYROS:
        fdm[f"ic/{rate}-rad_sec"] = np.deg2rad(wanted.get(rate, 0.0))
    for column, factor, write in writers(fdm, aircraft):
        write(wanted[COMMANDS[column]] * factor)
    stand(fdm, aircraft)


def stand(fdm: jsbsim.FGFDMExec, aircraft: Aircraft) -> None:
    """Take over the initial condition, motors running steadily, until nothing moves any more but the aircraft."""
    fdm.run_ic()
    propulsion = fdm.get_propulsion()
    motors = range(propulsion.get_num_engines())
    before = np.full(len(ACCELERATIONS), np.nan)
    for _ in range(40):
        if motors:
            if not all(fdm[_RUNNING.format(motor)] for motor in motors):
                fdm[_ALL_RUN[0]] = _ALL_RUN[1]
            if aircraft.spin_up:
                spin_up(fdm)
            elif aircraft.settle:
                if not settle(fdm):
                    return
            else:
                propulsion.get_steady_state()
        fdm.run_ic()
        now = np.array([fdm[name] for name in ACCELERATIONS])
        if np.all(np.abs(now - before) < _STANDS):
            return
        before = now


def writers(fdm: jsbsim.FGFDMExec, aircraft: Aircraft) -> list[tuple[int, float, Callable[[float], object]]]:
    """Return how commands reach an engine: for every property the command's column, a factor, and what writes it."""
    properties = fdm.get_property_manager()
    found: list[tuple[int, float, Callable[[float], object]]] = []
    for column, name in enumerate(COMMANDS):
        command = aircraft.commands[name]
        for number in count():
            node = properties.get_node(f"{command.property}[{number}]" if number else command.property)
            if node is None:
                break
            found.append((column, 1.0 / command.unit, node.set_double_value))
    return found


_INTEGRATORS = tuple(
    f"simulation/integrator/{what}/{motion}"
    for what in ("rate", "position")
    for motion in ("rotational", "translational")
)
_HELD = 0  # JSBSim's integrator that integrates nothing
_SHORTEST_S, _LONGEST_S = 1e-12, 2.0  # of a step
_GROWTH = 2.0  # of a step at most
_TURNS_RPM = 1.0  # below this it stands
_SETTLED = 1e-12  # of the speed, what a Newton step still changes
_NOISE = 1e-9  # of the speed: of smaller changes no slope is taken
_MOST_STEPS = 2000  # until an engine stands
_LOOKED_S, _STEADY_WITHIN_S = 1.0, 90.0  # between two looks, and in which it has to stand
_STEADY = 1e-9  # of the thrust, over a second


def propellers(fdm: jsbsim.FGFDMExec) -> list[str]:
    """Return the properties of every propeller's speed, in revolutions a minute."""
    properties = fdm.get_property_manager()
    motors = range(fdm.get_propulsion().get_num_engines())
    names = [
        f"propulsion/engine[{motor}]/propeller-rpm" if motor else "propulsion/engine/propeller-rpm" for motor in motors
    ]
    return [name for name in names if properties.get_node(name) is not None]


def wrong_speeds(fdm: jsbsim.FGFDMExec) -> list[str]:
    """Say of every propeller that can't turn as it does: it stands under power, or its tips are far beyond sound."""
    said, properties = [], fdm.get_property_manager()
    for number, name in enumerate(propellers(fdm)):
        engine, rpm = name.rpartition("/")[0], fdm[name]
        nodes = [properties.get_node(f"{engine}/{what}") for what in ("power-hp", "helical-tip-Mach")]
        power, mach = (0.0 if node is None else node.get_double_value() for node in nodes)  # not every kind has both
        which = f"propeller {number}"
        if power > 0.0 and abs(rpm) < _TURNS_RPM:
            said.append(f"{which} stands still under {power:.3g} hp")
        elif not (math.isfinite(rpm) and mach < 2.0):  # at a blade's tip: no propeller turns so
            said.append(f"{which} turns at {rpm:.3g} rpm, its tips at Mach {mach:.2g}")
    return said


def spin_up(fdm: jsbsim.FGFDMExec) -> float:
    """Turn all propellers until they are steady, the aircraft held; return their stiffness -f'(w) in 1/s."""
    names = propellers(fdm)
    if not names:
        return 0.0
    with held(fdm):
        return _turn(fdm, names)


@contextmanager
def held(fdm: jsbsim.FGFDMExec) -> Iterator[None]:
    """Keep the aircraft where it is while its engines, servos and filters run on."""
    period_s, before = fdm.get_delta_t(), [fdm[name] for name in _INTEGRATORS]
    for name in _INTEGRATORS:
        fdm[name] = _HELD
    try:
        yield
    finally:
        fdm.set_dt(period_s)
        for name, integrator in zip(_INTEGRATORS, before, strict=True):
            fdm[name] = integrator


def _turn(fdm: jsbsim.FGFDMExec, names: list[str]) -> float:
    step_s, stiffness = 1e-9, 0.0
    last: tuple[float, float] | None = None  # the last speed and its rate, of the propeller that changes most
    for _ in range(_MOST_STEPS):
        speeds = [fdm[name] for name in names]
        fdm.set_dt(step_s)
        fdm.run()
        changes = [fdm[name] - speed for name, speed in zip(names, speeds, strict=True)]
        most = max(range(len(names)), key=lambda i: abs(changes[i]))
        speed, change = speeds[most], changes[most]
        # a shorter step changes little anyway
        if abs(change) <= _SETTLED * max(abs(speed), _TURNS_RPM) and step_s > 1e-4:
            return stiffness
        rate, longest_s = change / step_s, step_s * _GROWTH
        if abs(change) > 0.3 * max(abs(speed), 100.0):  # so much of the speed in a step is too much
            longest_s = step_s / _GROWTH
        if last is not None and speed != last[0] and (slope := (rate - last[1]) / (speed - last[0])) < 0.0:
            stiffness = -slope if abs(change) > _NOISE * max(abs(speed), 1.0) else stiffness
            longest_s = min(longest_s, 1.0 / stiffness) if stiffness else longest_s
        last = speed, rate
        step_s = min(max(longest_s, _SHORTEST_S), _LONGEST_S)
    return stiffness


def settle(fdm: jsbsim.FGFDMExec) -> bool:
    """Run all engines until their thrust is steady, the aircraft held; say whether it is within 90 s."""
    steps = max(round(_LOOKED_S / fdm.get_delta_t()), 1)
    with held(fdm):
        before = thrusts_lbs(fdm)
        for _ in range(round(_STEADY_WITHIN_S / _LOOKED_S)):
            for _ in range(steps):
                fdm.run()
            now = thrusts_lbs(fdm)
            if all(abs(b - a) <= _STEADY * max(abs(b), 1.0) for a, b in zip(before, now, strict=True)):
                return True
            before = now
    return False


def thrusts_lbs(fdm: Any) -> list[float]:
    """Return the thrust of every engine."""
    return [fdm[f"propulsion/engine[{motor}]/thrust-lbs"] for motor in range(fdm.get_propulsion().get_num_engines())]


_LARGEST_BYTES = 20_000_000  # of a model's file
_DEEPEST = 100  # elements in elements: JSBSim's reader calls itself
_REACH_OUT = ("input", "output")  # JSBSim would write files anywhere, listen on ports and connect to hosts


def check_model(path: Path) -> tuple[str, ...]:
    """Refuse a model that isn't whole or leads out of its folder; return its sections that would reach outside."""
    if not is_file(path):
        others = sorted(there.name for there in path.parent.glob("*.xml"))[:5]
        holds = f"; it holds {', '.join(others)}: name the folder like the model" if others else ""
        raise InputError(
            f"{path.parent} is no aircraft's folder: no {path.name} (folder NAME holds a model, NAME.xml, "
            f"and perhaps aircraft.toml){holds}"
        )
    included, reaching_out = _checked(path)
    for name in included:
        if {"/", ".."}.intersection(PurePosixPath(name.replace("\\", "/")).parts):
            raise InputError(f"{path} includes '{name}'; a model's parts stand in its own folder")
        part = path.parent / name
        part = part if part.suffix == ".xml" else Path(f"{part}.xml")
        if part.exists():
            if not is_file(part):
                raise InputError(f"{path} includes {part}, which isn't a file")
            if sections := _checked(part)[1]:
                raise InputError(f"{part}, which {path.name} includes, has an <{sections[0]}> section; take it out")
    return reaching_out


@contextmanager
def loadable(path: Path, *, without_io: bool) -> Iterator[Path]:
    """Give a model's file as JSBSim may load it: itself, or for a while a copy without input and output sections."""
    reaching_out = check_model(path)
    if not reaching_out:
        yield path
        return
    if not without_io:
        raise InputError(
            f"{path} has an <{reaching_out[0]}> section, which would reach outside (files, ports); take it out, or "
            "leave such sections out: --without-io, or without_io = true in its aircraft.toml"
        )
    with tempfile.TemporaryDirectory() as aside:
        folder = Path(aside) / "aircraft" / path.parent.name
        for part in (*path.parent.glob("*.xml"), *path.parent.glob("*/*.xml")):  # Engines/, Systems/
            if is_file(part):
                copy = folder / part.relative_to(path.parent)
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(part, copy)
        tree = ET.parse(path)  # noqa: S314  there are no entities in it: checked
        root = tree.getroot()
        for section in [element for element in root if element.tag in _REACH_OUT]:
            root.remove(section)
        tree.write(folder / path.name, encoding="utf-8")
        yield folder / path.name


def description(path: Path) -> str:
    """Return what a checked model says that it is, in one line; "" where it says nothing."""
    said = ET.parse(path).getroot().findtext("fileheader/description") or ""  # noqa: S314  as above
    return " ".join(said.split())


def _checked(path: Path) -> tuple[list[str], tuple[str, ...]]:
    """Return the names of the files that a file includes, and its sections that reach outside."""
    open_elements: list[str] = []
    included: list[str] = []
    reaching_out: list[str] = []

    def begin(name: str, attributes: dict[str, str]) -> None:
        if len(open_elements) == 1 and name in _REACH_OUT:
            reaching_out.append(name)
        elif "file" in attributes and not set(reaching_out).intersection(open_elements[1:2]):
            included.append(attributes["file"])
        open_elements.append(name)
        if len(open_elements) > _DEEPEST:
            raise InputError(f"{path} has elements in elements, more than {_DEEPEST} deep; no model needs that")

    def end(_: str) -> None:
        open_elements.pop()

    def declares(*_: Any) -> None:
        raise InputError(f"{path} declares a document type; a model needs no entities, take it out")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler = declares
    check_size(path, "model", _LARGEST_BYTES)
    try:
        parser.Parse(path.read_bytes(), True)
    except InputError:
        raise
    except (expat.ExpatError, LookupError, ValueError) as error:  # the last two: an encoding that nobody knows
        raise InputError(f"{path} isn't whole XML: {error}") from error
    return included, tuple(reaching_out)
