"""Equilibrium: the steady, level, straight flight from which every flight starts, and an engine that stands in it."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from contextlib import suppress
from functools import lru_cache, partial
from pathlib import Path

import jsbsim
import numpy as np

from gtmbench.bench.aircraft import UNKNOWNS, Aircraft, aircraft_of, facts_of
from gtmbench.bench.autopilot import Trim
from gtmbench.bench.engine import ACCELERATIONS, engine, set_condition, silenced, simulating, thrusts_lbs, wrong_speeds
from gtmbench.checks import number
from gtmbench.errors import GtmbenchError, TrimError
from gtmbench.values.channels import CHANNELS, M_PER_FT, SURFACES
from gtmbench.values.record import FloatArray

TOLERANCE = 1e-6  # ft/s2 and rad/s2
_TOLERANCES = {"xtol": 1e-14, "ftol": 1e-15, "gtol": 1e-15}  # the search ends where nothing improves any more
_MOST_STEPS = 30  # the GTM takes three, the slowest known aircraft 22
_USUAL = 1.5  # times an aircraft's own altitude or speed, or that part of it
_SAME = 0.03  # of an altitude: so near it may be the same, in metres
_FT_PER_M, _KT_PER_M_S = 1.0 / M_PER_FT, 3600.0 / 1852.0  # by definition of foot and nautical mile
# Of degrees and percent. BLAS kernels find unknowns that differ by 1e-12 to 1e-11, a thousandth of this unit; half a
# unit leaves 1.6e-7 ft/s2 on an aircraft whose lift changes by 1 g per degree, a sixth of the tolerance.
_DECIMALS = 8
_FOUND: dict[tuple[object, ...], Trim] = {}  # by all that a search depends on


def trimmed_engine(
    aircraft: Aircraft, *, altitude_ft: float | None = None, tas_kt: float | None = None
) -> tuple[jsbsim.FGFDMExec, Trim]:
    """Return an engine that stands in trim, and the trim: by `searched_engine`, else by JSBSim's own trim."""
    altitude_ft = aircraft.altitude_ft if altitude_ft is None else altitude_ft
    tas_kt = aircraft.tas_kt if tas_kt is None else tas_kt
    try:
        return _searched_once(aircraft, altitude_ft, tas_kt)
    except TrimError as error:
        fixed = _fixed(aircraft, altitude_ft, tas_kt)
        found = trimmed_by_jsbsim(aircraft, fixed | aircraft.guess | {"theta": aircraft.guess["alpha"]})
        if found and np.all(np.abs(_accelerations(found[0])) < 1e-3):  # JSBSim's own trim leaves so much
            return found[0], _trim_flown(*found)
        raise TrimError(f"{error}; {_remedy(aircraft, altitude_ft, tas_kt)}") from error


def _searched_once(aircraft: Aircraft, altitude_ft: float, tas_kt: float) -> tuple[jsbsim.FGFDMExec, Trim]:
    """Do as `searched_engine`, with one search as long as the model and what is known of it stay the same."""
    what = (json.dumps(facts_of(aircraft)), aircraft.model, aircraft.model.stat().st_mtime_ns, altitude_ft, tas_kt)
    if known := _FOUND.get(what):
        angles = {"beta": known.beta_deg, "alpha": known.alpha_deg, "phi": known.roll_deg, "theta": known.pitch_deg}
        fdm = engine(aircraft)
        with simulating(fdm, aircraft), silenced():
            set_condition(fdm, aircraft, _fixed(aircraft, altitude_ft, tas_kt) | angles | known.commands)
        if np.all(np.abs(_accelerations(fdm)) < TOLERANCE):  # else its controls remember the search
            return fdm, known
    fdm, found = searched_engine(aircraft, altitude_ft=altitude_ft, tas_kt=tas_kt)
    if len(_FOUND) >= 64:
        _FOUND.clear()
    _FOUND[what] = found
    return fdm, found


def searched_engine(aircraft: Aircraft, *, altitude_ft: float, tas_kt: float) -> tuple[jsbsim.FGFDMExec, Trim]:
    """Return a fresh engine that stands in trim, and the trim, found by least squares.

    Not the one that was searched with: the states of a search leave traces in the last bits, and they are other states
    on another CPU. Only where a model's controls remember the search (an integrator), it is that one.
    """
    from scipy.optimize import least_squares  # half a second to import

    fixed = _fixed(aircraft, altitude_ft, tas_kt)

    def condition(unknowns: FloatArray) -> dict[str, float]:
        values = dict(zip(UNKNOWNS, unknowns.tolist(), strict=True))
        if aircraft.rudderless or aircraft.motorless:
            return fixed | _slipping_or_gliding(aircraft, values)
        # level flight without sideslip: tan(theta) = tan(alpha) cos(phi)
        theta = math.atan(math.tan(math.radians(values["alpha"])) * math.cos(math.radians(values["phi"])))
        return {**fixed, **values, "theta": math.degrees(theta)}

    def accelerations(fdm: jsbsim.FGFDMExec, unknowns: FloatArray) -> FloatArray:
        set_condition(fdm, aircraft, condition(unknowns))
        return _accelerations(fdm)

    low, high = (np.array(bound) for bound in zip(*(aircraft.searched[name] for name in UNKNOWNS), strict=True))
    guess = np.array([aircraft.guess[name] for name in UNKNOWNS])
    searched = engine(aircraft)
    try:
        with simulating(searched, aircraft), silenced():
            search = partial(accelerations, searched)
            solution = least_squares(
                search,
                guess,
                bounds=(low, high),
                x_scale=1.0 + np.abs(guess),
                max_nfev=_MOST_STEPS,
                # a step of an unknown, for slopes: thrust that settles is known to 1e-9 of itself
                diff_step=1e-4 if aircraft.settle else None,
                **_TOLERANCES,
            )
    except ValueError as error:
        raise TrimError(
            f"no trim for '{aircraft.name}': its accelerations aren't all numbers; check the model"
        ) from error
    x = np.round(solution.x, _DECIMALS)
    for fdm in (engine(aircraft), searched):
        with simulating(fdm, aircraft), silenced():
            left = accelerations(fdm, x)
        if np.all(np.abs(left) < TOLERANCE):
            return fdm, _trim_flown(fdm, condition(x))
    wrong = [*wrong_speeds(searched), *_misfits(searched)]
    raise TrimError("; ".join([_failure(aircraft, fixed, x, left, low, high), *wrong]))


def _slipping_or_gliding(aircraft: Aircraft, values: dict[str, float]) -> dict[str, float]:
    """Return the condition with a sideslip that stands where the rudder would, a path angle where the throttle would.

    With a = cos(alpha) cos(beta) and b = sin(phi) sin(beta) + cos(phi) sin(alpha) cos(beta) the flight path angle is
    sin(gamma) = a sin(theta) - b cos(theta).
    """
    stands = ({"beta": "rudder"} if aircraft.rudderless else {}) | ({"gamma": "throttle"} if aircraft.motorless else {})
    given = {name: values[command] for name, command in stands.items()}
    alpha, phi = (math.radians(values[name]) for name in ("alpha", "phi"))
    beta, gamma = (math.radians(given.get(name, 0.0)) for name in ("beta", "gamma"))
    along = math.cos(alpha) * math.cos(beta)
    across = math.sin(phi) * math.sin(beta) + math.cos(phi) * math.sin(alpha) * math.cos(beta)
    theta = math.atan2(across, along) + math.asin(min(max(math.sin(gamma) / math.hypot(along, across), -1.0), 1.0))
    level = {"beta": given.get("beta", 0.0), "theta": math.degrees(theta)}
    return {**values, **dict.fromkeys(stands.values(), 0.0), **level}


def _fixed(aircraft: Aircraft, altitude_ft: float, tas_kt: float) -> dict[str, float]:
    return {
        "altitude": number("altitude_ft", altitude_ft, *aircraft.envelope["altitude"]),
        "tas": number("tas_kt", tas_kt, 0.0, 2000.0, above=True),
        "psi": aircraft.psi_deg,
        "beta": 0.0,
    }


def _accelerations(fdm: jsbsim.FGFDMExec) -> FloatArray:
    return np.array([fdm[name] for name in ACCELERATIONS])


def mistaken_units(aircraft: Aircraft, *, altitude_ft: float | None = None, tas_kt: float | None = None) -> str:
    """Say which figure of a condition is the aircraft's own in metres or m/s, if one is; else ""."""
    said = []
    if altitude_ft and math.isclose(altitude_ft * _FT_PER_M, aircraft.altitude_ft, rel_tol=_SAME):
        said.append(f"{altitude_ft:g} m is {aircraft.name}'s own altitude; altitudes are in ft")
    if tas_kt and math.isclose(tas_kt * _KT_PER_M_S, aircraft.tas_kt, rel_tol=_SAME):
        said.append(f"{tas_kt:g} m/s is {aircraft.name}'s own speed; speeds are in kt")
    return "; ".join(said)


def _remedy(aircraft: Aircraft, altitude_ft: float, tas_kt: float) -> str:
    """Say what to try: the same numbers in other units, where these are usual for the aircraft and trim."""
    in_feet, in_knots = altitude_ft * _FT_PER_M, tas_kt * _KT_PER_M_S
    metres = _is_usual(in_feet, aircraft.altitude_ft)
    metres_per_second = _is_usual(in_knots, aircraft.tas_kt)
    for altitude, tas, possible, meant in (
        (altitude_ft, in_knots, metres_per_second, f"{tas_kt:g} m/s"),
        (in_feet, tas_kt, metres, f"{altitude_ft:g} m"),
        (in_feet, in_knots, metres and metres_per_second, f"{altitude_ft:g} m and {tas_kt:g} m/s"),
    ):
        if possible:
            with suppress(GtmbenchError):
                searched_engine(aircraft, altitude_ft=altitude, tas_kt=tas)
                return f"{meant} would trim: if that was meant, give {altitude:.6g} ft and {tas:.6g} kt"
    return "try another speed or altitude"


def _is_usual(value: float, own: float) -> bool:
    return own / _USUAL < value < own * _USUAL


def _failure(
    aircraft: Aircraft, fixed: dict[str, float], x: FloatArray, left: FloatArray, low: FloatArray, high: FloatArray
) -> str:
    worst = int(np.argmax(np.abs(left)))
    name, what = list(ACCELERATIONS.items())[worst]
    margin = 1e-3 * (high - low)
    instead = ({"rudder": "sideslip"} if aircraft.rudderless else {}) | (
        {"throttle": "flight path angle"} if aircraft.motorless else {}
    )
    stuck = [
        f"{instead.get(unknown, unknown)} at its limit of {value:.4g}"
        for unknown, value, bottom, top, slack in zip(UNKNOWNS, x, low, high, margin, strict=True)
        if value < bottom + slack or value > top - slack
    ]
    return (
        f"no trim for '{aircraft.name}' at {fixed['altitude']:g} ft and {fixed['tas']:g} kt true airspeed: the {what} "
        f"stays at {left[worst]:.3g} {name.rsplit('-', 1)[1].replace('_sec2', '/s2')}"
        f"{', with ' + ' and '.join(stuck) if stuck else ''}"
    )


def _misfits(fdm: jsbsim.FGFDMExec) -> list[str]:
    """Say what else about a model keeps it from flying level: its engines, its gear, its mass."""
    said = []
    motors = fdm.get_propulsion().get_num_engines()
    engines = [f"propulsion/engine[{number}]" for number in range(motors)]
    still = [i for i, each in enumerate(engines) if not fdm[f"{each}/set-running"] and not fdm[f"{each}/thrust-lbs"]]
    if still:
        said.append(f"engine {', '.join(map(str, still))} isn't running")
    elif motors:
        said.append(f"its engines give {sum(thrusts_lbs(fdm)):.3g} lbs of thrust")
    else:
        said.append("it has no engine, so it was tried as a glider")
    if any(fdm[f"forces/fb{axis}-gear-lbs"] for axis in "xyz"):
        said.append("its gear touches something in the air; check <ground_reactions>")
    if not fdm["inertia/weight-lbs"] > 0.0:
        said.append(f"its weight is {fdm['inertia/weight-lbs']:g} lbs; check <mass_balance>")
    return said


def _rounded(angle_deg: float) -> float:
    """Return an angle as the unknowns are given; level flight isn't -0 deg."""
    return round(angle_deg, _DECIMALS) + 0.0


def _trim_flown(fdm: jsbsim.FGFDMExec, at: dict[str, float]) -> Trim:
    knots = CHANNELS["tas"].scale
    return Trim(
        altitude_ft=at["altitude"],
        eas_kt=float(fdm["velocities/vt-fps"] * knots * np.sqrt(fdm["atmosphere/sigma"])),
        tas_kt=fdm["velocities/vt-fps"] * knots,
        alpha_deg=at["alpha"],
        beta_deg=at["beta"],
        gamma_deg=_rounded(math.degrees(fdm["flight-path/gamma-rad"])),
        roll_deg=at["phi"],
        pitch_deg=at["theta"],
        yaw_deg=at["psi"],
        ground_track_deg=_rounded(math.degrees(fdm["flight-path/psi-gt-rad"])),
        elevator_deg=at["elevator"],
        aileron_deg=at["aileron"],
        rudder_deg=at["rudder"],
        throttle_percent=at["throttle"],
    )


_LONGEST_S = 10.0  # that JSBSim's own trim may take
_FULL = 1  # its mode: all six axes
_NORMALISED = "-cmd-norm"
_TABS = ("pitch", "roll", "yaw")  # what it moves in place of elevator, aileron and rudder, where it pleases


def trimmed_by_jsbsim(aircraft: Aircraft, wanted: dict[str, float]) -> tuple[jsbsim.FGFDMExec, dict[str, float]] | None:
    """Return an engine that JSBSim has trimmed, and the condition it stands in; None where it couldn't.

    It moves normalised commands and none of another kind. It can't be interrupted, so another process goes before,
    which can.

    `wanted`: the condition from which it begins, as for `set_condition`.
    """
    if aircraft.motorless or not all(command.property.endswith(_NORMALISED) for command in aircraft.commands.values()):
        return None
    task = json.dumps([str(aircraft.folder), facts_of(aircraft), wanted])
    tried = _is_rehearsed(task, aircraft.model.stat().st_mtime_ns, _LONGEST_S)
    return _trimmed(aircraft, wanted) if tried else None


@lru_cache(maxsize=32)
def _is_rehearsed(task: str, _modified_ns: int, longest_s: float) -> bool:
    """Try a trim in another process, once as long as the model stays the same."""
    rehearsal = [sys.executable, "-c", f"from {__name__} import rehearse; rehearse()"]
    beside = Path(__file__).parents[2]  # Python looks for modules where it runs: there, not among a user's files
    try:
        done = subprocess.run(
            rehearsal, input=task, text=True, capture_output=True, timeout=longest_s, check=False, cwd=beside
        )
    except (subprocess.TimeoutExpired, OSError):
        return False
    return done.returncode == 0


def rehearse() -> None:
    """Trim what stdin tells of; end with code 0 where that can be done."""
    folder, facts, wanted = json.load(sys.stdin)
    sys.exit(_trimmed(aircraft_of(Path(folder), facts), wanted) is None)


def _trimmed(aircraft: Aircraft, wanted: dict[str, float]) -> tuple[jsbsim.FGFDMExec, dict[str, float]] | None:
    fdm = engine(aircraft)
    try:
        with simulating(fdm, aircraft), silenced():
            set_condition(fdm, aircraft, wanted)
            fdm.do_trim(_FULL)
            # a command and its tab add up; nothing may be initialised again: JSBSim forgets its trim then
            for tab, name in zip(_TABS, SURFACES, strict=True):
                fdm[aircraft.commands[name].property] += fdm[f"fcs/{tab}-trim{_NORMALISED}"]
                fdm[f"fcs/{tab}-trim{_NORMALISED}"] = 0.0
    except GtmbenchError:
        return None
    angles = {name: float(np.rad2deg(fdm[f"attitude/{name}-rad"])) for name in ("phi", "theta")}
    commands = {name: fdm[command.property] * command.unit for name, command in aircraft.commands.items()}
    return fdm, {**wanted, **angles, "alpha": float(np.rad2deg(fdm["aero/alpha-rad"])), **commands}
