"""A survey: what `aircraft.toml` would say of a JSBSim model that has none, found by trying."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from gtmbench.bench.aircraft import MOST_STEPS, SAMPLE_PERIOD_S, Aircraft, aircraft_of
from gtmbench.bench.autopilot import Trim
from gtmbench.bench.engine import (
    ACCELERATIONS,
    check_model,
    description,
    engine,
    set_condition,
    settle,
    silenced,
    simulating,
    spin_up,
    stand,
    thrusts_lbs,
    writers,
    wrong_speeds,
)
from gtmbench.bench.equilibrium import searched_engine, trimmed_engine
from gtmbench.bench.excitation import multisine
from gtmbench.checks import printable
from gtmbench.errors import GtmbenchError
from gtmbench.values.channels import CHANNELS, COMMANDS, SURFACES

Facts = dict[str, Any]

_NORMALISED = {  # each model has them; 1 of JSBSim's aileron rolls right, 1 deg of the channel's left
    "elevator": ("fcs/elevator-cmd-norm", 1.0),
    "aileron": ("fcs/aileron-cmd-norm", -1.0),
    "rudder": ("fcs/rudder-cmd-norm", 1.0),
}
_THROTTLE = "fcs/throttle-cmd-norm"
_POSITIONS = {
    "elevator": ("fcs/elevator-pos-deg",),
    "aileron": ("fcs/left-aileron-pos-deg", "fcs/right-aileron-pos-deg"),
    "rudder": ("fcs/rudder-pos-deg",),
}
_NOMINAL_DEG = 20.0  # full deflection, where a model doesn't tell it
# Gear up; and no fuel is burnt: else weight and trim change, and motors whose tank is small stop within the minute.
_CRUISE = {"gear/gear-cmd-norm": 0.0, "gear/gear-pos-norm": 0.0, "propulsion/fuel_freeze": 1.0}
# of every engine: JSBSim's commands of mixture and propeller
_MOTOR = {"fcs/mixture-cmd-norm": 0.9, "fcs/advance-cmd-norm": 1.0}
_MISSING = re.compile(r"property (\S+) does not exist")

_UNSETTLED = 0.01  # of the weight: by how much an engine's thrust may differ from what JSBSim finds
_NOTHING = 1e-9  # ft/s2 and rad/s2: what a rudder that isn't there does
_LIFT = (0.4, 0.6, 0.3, 0.8, 0.2, 0.15, 0.1)  # lift coefficients at which a trim is looked for
_LONGEST_S = 10.0  # of processor time, to look for one
_HEAVY_LBS_FT2 = 30.0  # wing loading from which an aircraft is at home at 10,000 ft, not at 5,000
_LOW_FT = 1_000.0  # where engines have the most power
# deg, deg, deg, ft: where nothing is known of a model
_ENVELOPE = {"alpha": [-12.0, 25.0], "beta": [-30.0, 30.0], "phi": [-80.0, 80.0], "altitude": [0.0, 60000.0]}
# deg, percent: where a search for trim begins
_GUESS = {"alpha": 3.0, "phi": 0.0, "elevator": 0.0, "aileron": 0.0, "rudder": 0.0, "throttle": 50.0}

_TURNED = {"elevator": "q", "aileron": "p", "rudder": "r"}
_TURNED_DEG_S = 2.0  # RMS, of the axis that a surface is for, by an excitation on that surface alone
_TRIED_S, _TRIED_SHARE = 30.0, 0.05  # s, of full deflection
_MOST_SHARE = 0.4  # of full deflection, for 1 deg of the GTM: doublets then take four fifths


def survey(folder: Path, *, without_io: bool = False) -> Facts:
    """Return the facts of a model, as its ``aircraft.toml`` would have them.

    Commands are JSBSim's normalised ones unless the model has the channel table's own; full deflection is what the
    model's surfaces do at full command; trim is looked for at speeds that the wing loading suggests; excitations are
    scaled so that a multisine on one surface turns the aircraft by 2 deg/s (RMS) about that surface's axis.

    `without_io`: whether input and output sections are left out.
    """
    facts = outline(folder, without_io=without_io)
    tried = list(_conditions(aircraft_of(folder, facts)))
    found = _trim_at_one_of(tried, folder, facts)
    if found is None:
        facts["trim"] |= dict(zip(("altitude_ft", "tas_kt"), tried[0], strict=True))
        return facts
    guess = {"alpha": found.alpha_deg, "phi": found.roll_deg, **found.commands}
    if facts.get("motorless"):
        guess["throttle"] = found.gamma_deg
    facts["trim"] |= {"altitude_ft": found.altitude_ft, "tas_kt": round(found.tas_kt, 6)}
    facts["trim"]["guess"] = {name: round(value, 4) + 0.0 for name, value in guess.items()}
    return facts | {"excitation": _scaled(aircraft_of(folder, facts))}


def _trim_at_one_of(conditions: list[tuple[float, float]], folder: Path, facts: Facts) -> Trim | None:
    """Return the first trim that is found, at last of the likeliest condition by JSBSim's own search."""
    until_s = time.process_time() + _LONGEST_S
    craft = aircraft_of(folder, facts)
    begun = [craft, replace(craft, guess=craft.guess | {"throttle": 90.0})] if craft.settle else [craft]  # percent
    for search, some in ((searched_engine, conditions), (trimmed_engine, conditions[:1])):
        for (altitude_ft, tas_kt), each in product(some, begun if search is searched_engine else [craft]):
            if time.process_time() < until_s:
                with suppress(GtmbenchError):
                    return search(each, altitude_ft=altitude_ft, tas_kt=tas_kt)[1]
    return None


def outline(folder: Path, *, without_io: bool) -> Facts:
    """Return what is known of a model before a trim is: the facts, with a condition that may be none."""
    model = folder / f"{folder.name}.xml"
    check_model(model)
    facts: Facts = {
        "title": printable(description(model))[:60] or folder.name,
        "without_io": without_io,
        "trim": {"altitude_ft": 5000.0, "tas_kt": 150.0, "psi_deg": 45.0, "latitude_deg": 37.0, "guess": dict(_GUESS)},
        "limits": {name: [-_NOMINAL_DEG, _NOMINAL_DEG] for name in SURFACES} | {"throttle": [0.0, 100.0]},
        "envelope": dict(_ENVELOPE),
        "commands": {
            name: {"property": property_, "unit": sign * _NOMINAL_DEG}
            for name, (property_, sign) in _NORMALISED.items()
        }
        | {"throttle": {"property": _THROTTLE, "unit": 100.0}},
        "properties": dict(_CRUISE),
    }
    try:
        fdm = engine(aircraft_of(folder, facts | {"commands": {}}))  # the channel table's, as the GTM has them
        facts["commands"] = {}
    except GtmbenchError:
        gliding = _gliding(facts)
        fdm = engine(aircraft_of(folder, gliding))
        if fdm.get_propulsion().get_num_engines():
            fdm = engine(aircraft_of(folder, facts))
        else:
            facts = gliding
        for motor in range(fdm.get_propulsion().get_num_engines()):
            facts["properties"] |= {f"{name}[{motor}]" if motor else name: value for name, value in _MOTOR.items()}

    facts["properties"] |= dict.fromkeys(_missing(folder, facts), 0.0)
    for name, full_deg in _full_deflections(aircraft_of(folder, facts)).items():
        if name in facts["commands"]:
            facts["commands"][name]["unit"] = math.copysign(full_deg, facts["commands"][name]["unit"])
        facts["limits"][name] = [-full_deg, full_deg]
    return facts | _of_propellers(folder, facts) | _of_rudder(folder, facts)


def _gliding(facts: Facts) -> Facts:
    """Return the facts of what has no motor."""
    guess = facts["trim"]["guess"] | {"throttle": -3.0}  # where a search for a steady descent begins
    return facts | {"motorless": True, "trim": facts["trim"] | {"guess": guess}}


def _of_propellers(folder: Path, facts: Facts) -> Facts:
    """Say whether propellers have to be turned up, and how short JSBSim's steps have to be for them."""
    craft = aircraft_of(folder, facts)
    fdm, is_wrong, stiffness = engine(craft), False, 0.0
    with simulating(fdm, craft), silenced():
        for throttle in (20.0, 50.0, 100.0):
            _level(fdm, craft, {"throttle": throttle})
            is_wrong = is_wrong or bool(wrong_speeds(fdm))
    if not is_wrong:
        return _of_engines(folder, facts)
    craft = replace(craft, spin_up=True)
    fdm = engine(craft)
    throttles = [(factor, write) for column, factor, write in writers(fdm, craft) if COMMANDS[column] == "throttle"]
    with simulating(fdm, craft), silenced():
        for throttle in (20.0, 50.0, 100.0):
            _level(fdm, craft, {"throttle": throttle / 2.0})
            for factor, write in throttles:
                write(throttle * factor)
            stiffness = max(stiffness, spin_up(fdm))  # of propellers that aren't steady yet
    # a step of JSBSim is half of a propeller's time constant at most
    steps = math.ceil(stiffness * SAMPLE_PERIOD_S / 0.5)
    return {"spin_up": True} | ({"steps_a_sample": min(steps, MOST_STEPS)} if steps > 1 else {})


def _of_engines(folder: Path, facts: Facts) -> Facts:
    """Say whether engines have to settle: they can, at another thrust than JSBSim finds for them."""
    craft = aircraft_of(folder, facts)
    fdm, differs = engine(craft), False
    with simulating(fdm, craft), silenced():
        for throttle in (30.0, 60.0, 100.0):
            _level(fdm, craft, {"throttle": throttle})
            found = sum(thrusts_lbs(fdm))
            if not settle(fdm):
                return {}
            differs = differs or abs(sum(thrusts_lbs(fdm)) - found) > _UNSETTLED * fdm["inertia/weight-lbs"]
    return {"settle": True} if differs else {}


def _of_rudder(folder: Path, facts: Facts) -> Facts:
    """Say whether nothing answers the rudder command."""
    craft = aircraft_of(folder, facts)
    fdm, turned = engine(craft), []
    with simulating(fdm, craft), silenced():
        for command in craft.limits["rudder"]:
            _level(fdm, craft, {"rudder": command, "throttle": 0.0})
            turned.append([fdm[name] for name in ACCELERATIONS])
    moved = np.abs(np.array(turned[0]) - np.array(turned[1]))
    return {"rudderless": True} if moved.max() < _NOTHING else {}


def _missing(folder: Path, facts: Facts) -> list[str]:
    """Return the properties that the model reads and nobody has: another simulator's, which JSBSim names one by one."""
    missing: list[str] = []
    while len(missing) < 60:
        craft = aircraft_of(folder, facts | {"properties": facts["properties"] | dict.fromkeys(missing, 0.0)})
        fdm = engine(craft)  # one that has missed a property flies no more
        try:
            with simulating(fdm, craft), silenced():
                _level(fdm, craft, {})
                for _ in range(3):
                    fdm.run()
        except GtmbenchError as error:
            found = _MISSING.search(str(error))
            if not found:
                raise
            missing.append(found[1])
        else:
            break
    return missing


def _level(fdm: Any, craft: Aircraft, commands: dict[str, float]) -> None:
    at = {
        "altitude": craft.altitude_ft,
        "tas": craft.tas_kt,
        "alpha": 3.0,
        "beta": 0.0,
        "psi": craft.psi_deg,
        "phi": 0.0,
    }
    set_condition(fdm, craft, at | {"theta": 3.0, **dict.fromkeys(SURFACES, 0.0), "throttle": 50.0} | commands)


def _full_deflections(craft: Aircraft) -> dict[str, float]:
    """Return by surface the mean of what it does at full command to either side, in deg."""
    fdm, full = engine(craft), {}
    properties = fdm.get_property_manager()
    with simulating(fdm, craft), silenced():
        for name, positions in _POSITIONS.items():
            sides = []
            for command in craft.limits[name]:
                _level(fdm, craft, {name: command})
                sides.append(
                    max(abs(fdm[position]) if properties.get_node(position) else 0.0 for position in positions)
                )
            full[name] = round(sum(sides) / 2.0, 1) or _NOMINAL_DEG
    return full


def _conditions(craft: Aircraft) -> Iterator[tuple[float, float]]:
    """Give altitudes (ft) and true airspeeds (kt), the likeliest first, by the wing loading."""
    fdm = engine(craft)
    with simulating(fdm, craft), silenced():
        stand(fdm, craft)
        loading = fdm["inertia/weight-lbs"] / max(fdm["metrics/Sw-sqft"], 0.1)
        densities = {}
        for altitude_ft in (10_000.0 if loading > _HEAVY_LBS_FT2 else 5_000.0, _LOW_FT):
            fdm["ic/h-sl-ft"] = altitude_ft
            stand(fdm, craft)
            densities[altitude_ft] = fdm["atmosphere/rho-slugs_ft3"]
    for (altitude_ft, density), lift in product(densities.items(), _LIFT):
        tas_kt = math.sqrt(2.0 * loading / (density * lift)) * CHANNELS["tas"].scale
        yield altitude_ft, float(np.clip(round(tas_kt), 5.0, 2000.0))


def _scaled(craft: Aircraft) -> dict[str, float]:
    """Return by surface how many times what excitations move on the GTM turns this aircraft as much as is wanted."""
    time_s = np.arange(0.0, _TRIED_S, SAMPLE_PERIOD_S)
    moved = multisine(time_s, 1).surfaces
    scale = {}
    for column, name in enumerate(COMMANDS):
        if name not in SURFACES:
            continue
        fdm, trim = trimmed_engine(craft)
        full = craft.limits[name][1]
        commands = np.tile(list(trim.commands.values()), (len(time_s), 1))
        commands[:, column] += _TRIED_SHARE * full * moved[name]
        rate = CHANNELS[_TURNED[name]]
        columns, factors, write = zip(*writers(fdm, craft), strict=True)
        turned = []
        with simulating(fdm, craft), silenced():
            for values in (commands[:, columns] * factors).tolist():
                for to_property, value in zip(write, values, strict=True):
                    to_property(value)
                for _ in range(craft.steps_a_sample):
                    fdm.run()
                turned.append(fdm[rate.jsbsim] * rate.scale)
        rms = float(np.std(turned))
        wanted = _TURNED_DEG_S / rms * _TRIED_SHARE * full if rms > 0.0 else np.inf
        scale[name] = float(f"{min(wanted, _MOST_SHARE * full):.3g}") if np.isfinite(wanted) else 1.0
    return scale
