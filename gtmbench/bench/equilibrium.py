"""Equilibrium: the steady, level, straight flight from which every flight starts, and an engine that stands in it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import jsbsim
import numpy as np

from gtmbench.bench.aircraft import UNKNOWNS, Aircraft
from gtmbench.bench.engine import engine, silenced, simulating, stand, writers
from gtmbench.channels import CHANNELS, COMMANDS
from gtmbench.checks import number
from gtmbench.errors import TrimError
from gtmbench.record import FloatArray

# The six accelerations that vanish in trim, with what each is driven by.
ACCELERATIONS = {
    "accelerations/udot-ft_sec2": "forward acceleration (thrust against drag)",
    "accelerations/vdot-ft_sec2": "sideward acceleration (side force against bank)",
    "accelerations/wdot-ft_sec2": "downward acceleration (lift against weight)",
    "accelerations/pdot-rad_sec2": "roll acceleration (ailerons)",
    "accelerations/qdot-rad_sec2": "pitch acceleration (elevator)",
    "accelerations/rdot-rad_sec2": "yaw acceleration (rudder)",
}
TOLERANCE = 1e-6  # ft/s2 and rad/s2
# Of degrees and percent. BLAS kernels find unknowns that differ by 1e-12 to 1e-11, a thousandth of this unit; half a
# unit leaves 1.6e-7 ft/s2 on an aircraft whose lift changes by 1 g per degree, a sixth of the tolerance.
_DECIMALS = 8


@dataclass(frozen=True, kw_only=True)
class Trim:
    """Steady level flight: condition, attitude and commands. Angles in degrees, units in the names."""

    altitude_ft: float
    eas_kt: float
    tas_kt: float
    alpha_deg: float
    beta_deg: float
    gamma_deg: float
    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    ground_track_deg: float
    elevator_deg: float
    aileron_deg: float
    rudder_deg: float
    throttle_percent: float

    @property
    def commands(self) -> dict[str, float]:
        """The trimmed commands by channel, in the channel's unit."""
        return {
            "elevator": self.elevator_deg,
            "aileron": self.aileron_deg,
            "rudder": self.rudder_deg,
            "throttle": self.throttle_percent,
        }


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
    for rate in ("p", "q", "r"):
        fdm[f"ic/{rate}-rad_sec"] = np.deg2rad(wanted.get(rate, 0.0))
    for column, factor, write in writers(fdm, aircraft):
        write(wanted[COMMANDS[column]] * factor)
    stand(fdm)


def trimmed_engine(
    aircraft: Aircraft, *, altitude_ft: float | None = None, tas_kt: float | None = None
) -> tuple[jsbsim.FGFDMExec, Trim]:
    """Return a fresh engine that stands in trim, and the trim.

    Not the one that was searched with: the states of a search leave traces in the last bits, and they are other states
    on another CPU.
    """
    from scipy.optimize import least_squares  # half a second to import

    altitude_ft = aircraft.altitude_ft if altitude_ft is None else altitude_ft
    tas_kt = aircraft.tas_kt if tas_kt is None else tas_kt
    fixed = {
        "altitude": number("altitude_ft", altitude_ft, *aircraft.envelope["altitude"]),
        "tas": number("tas_kt", tas_kt, 0.0, 2000.0, above=True),
        "psi": aircraft.psi_deg,
        "beta": 0.0,
    }

    def condition(unknowns: FloatArray) -> dict[str, float]:
        values = dict(zip(UNKNOWNS, unknowns.tolist(), strict=True))
        # level flight without sideslip: tan(theta) = tan(alpha) cos(phi)
        theta = math.atan(math.tan(math.radians(values["alpha"])) * math.cos(math.radians(values["phi"])))
        return {**fixed, **values, "theta": math.degrees(theta)}

    def accelerations(fdm: jsbsim.FGFDMExec, unknowns: FloatArray) -> FloatArray:
        set_condition(fdm, aircraft, condition(unknowns))
        return np.array([fdm[name] for name in ACCELERATIONS])

    low, high = (np.array(bound) for bound in zip(*(aircraft.searched[name] for name in UNKNOWNS), strict=True))
    guess = np.array([aircraft.guess[name] for name in UNKNOWNS])
    searched = engine(aircraft)
    try:
        with simulating(searched, aircraft), silenced():
            search = partial(accelerations, searched)
            solution = least_squares(search, guess, bounds=(low, high), x_scale=1.0 + np.abs(guess), xtol=1e-14)
    except ValueError as error:
        raise TrimError(
            f"no trim for '{aircraft.name}': its accelerations aren't all numbers; check the model"
        ) from error
    fdm, x = engine(aircraft), np.round(solution.x, _DECIMALS)
    with simulating(fdm, aircraft), silenced():
        left = accelerations(fdm, x)
    if not np.all(np.abs(left) < TOLERANCE):
        raise TrimError(_failure(aircraft, fixed, x, left, low, high))
    return fdm, _read(fdm, condition(x))


def _failure(
    aircraft: Aircraft, fixed: dict[str, float], x: FloatArray, left: FloatArray, low: FloatArray, high: FloatArray
) -> str:
    worst = int(np.argmax(np.abs(left)))
    name, what = list(ACCELERATIONS.items())[worst]
    margin = 1e-3 * (high - low)
    stuck = [
        f"{unknown} at its limit of {value:.4g}"
        for unknown, value, bottom, top, slack in zip(UNKNOWNS, x, low, high, margin, strict=True)
        if value < bottom + slack or value > top - slack
    ]
    return (
        f"no trim for '{aircraft.name}' at {fixed['altitude']:g} ft and {fixed['tas']:g} kt true airspeed: the {what} "
        f"stays at {left[worst]:.3g} {name.rsplit('-', 1)[1].replace('_sec2', '/s2')}"
        f"{', with ' + ' and '.join(stuck) if stuck else ''}; try another speed or altitude"
    )


def _rounded(angle_deg: float) -> float:
    """Return an angle as the unknowns are given; level flight isn't -0 deg."""
    return round(angle_deg, _DECIMALS) + 0.0


def _read(fdm: jsbsim.FGFDMExec, at: dict[str, float]) -> Trim:
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
