"""Gains of an autopilot for any aircraft: the GTM's, as fast for its motion and surfaces, then flown and compared."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gtmbench.bench.aircraft import Aircraft
from gtmbench.bench.autopilot import Autopilot
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.bench.loop import fly_in_loop
from gtmbench.bench.loop_flight import LoopFlight
from gtmbench.bench.modes import STATES, LinearModel, linearised
from gtmbench.bench.sensor_chain import IDEAL, SensorChain, SensorPath
from gtmbench.errors import EnvelopeError, GtmbenchError, TrimError
from gtmbench.jobs.progress import Progress, silent
from gtmbench.values.channels import ATTITUDE, COMMANDS, FT_S_PER_KT, G_FT_S2, GYROS
from gtmbench.values.record import Record

# What an axis' gains are changed by together; each in octaves, so that neighbours are half and twice a gain.
AXES = {
    "pitch": ("q_to_elevator_s", "theta_to_elevator"),
    "roll": ("p_to_aileron_s", "phi_to_aileron"),
    "yaw": ("r_to_rudder_s",),
    "height": ("altitude_to_theta_deg_ft", "altitude_integral_deg_ft_s"),
    "speed": ("tas_to_throttle_percent_kt", "tas_integral_percent_kt_s"),
}
OCTAVES = (-4, -3, -2, -1, 0, 1)  # of factors that are tried on the gains of an axis
_TRIED_S = 90.0  # of a flight by which gains are compared
_PROVED_S = 600.0  # of the flight that the gains found have to hold
# of a flight on later readings; by how much later, and how often
_MARGIN_S, _MARGIN_STEP_S, _MARGIN_STEPS = 30.0, 0.005, 20
_TOLERATED = {"altitude": 20.0, "tas": 5.0, "phi": 5.0, "psi": 5.0, "p": 5.0, "q": 2.0, "r": 2.0}  # RMS, by channel
_NO_EFFECT = 1e-6  # deg/s2 by deg, ft/s2 by percent: a command that moves nothing
_MOVED = 0.1  # RMS of a command, of its span: as bad as a channel's tolerated RMS


@dataclass(frozen=True, kw_only=True)
class Tuned:
    """Gains that were found, and how well they held the aircraft in ten minutes of moderate turbulence.

    Attributes
    ----------
    autopilot : Autopilot
    altitude_off_ft, tas_off_kt, bank_deg : float
        The greatest deviations of altitude and speed from the trim, and the greatest bank, in either direction.
    rates_deg_s : dict of str to float
        The RMS of p, q and r.
    delay_margin_s : float
        By how much later all gyros and angles may come, in steps of 5 ms, before the aircraft departs or RMS q doubles.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gains = gb.Autopilot(**vars(gb.load_aircraft("gtm").autopilot))
    >>> gb.Tuned(autopilot=gains, altitude_off_ft=31.0, tas_off_kt=2.4, bank_deg=4.2).altitude_off_ft
    31.0
    """

    autopilot: Autopilot
    altitude_off_ft: float
    tas_off_kt: float
    bank_deg: float
    rates_deg_s: dict[str, float] = field(default_factory=dict)
    delay_margin_s: float = math.nan


def find_autopilot(
    aircraft: str | Path | Aircraft, *, sensors: str | SensorChain = IDEAL, progress: Progress = silent
) -> Tuned:
    """Find gains that hold an aircraft in turbulence.

    They begin with the GTM's by similarity: each loop as fast as there, in terms of the aircraft's own short period,
    roll, dutch roll and speed, through what its surfaces and its throttle do (so signs follow from trying, too). Then
    each axis in turn is flown in turbulence with its gains in octaves, and that gain is taken whose worst neighbour,
    half or twice itself, does best: a gain with a margin on either side. At last they fly ten minutes of other air.
    On a sensor chain the rates lead by as much as the slowest gyro is late. An aircraft whose rudder moves nothing gets
    no yaw damper: its gain stays 0.

    Parameters
    ----------
    aircraft : str, Path or Aircraft
        As `fly` takes it.
    sensors : "ideal", "chain" or SensorChain
        As `fly_in_loop` takes them.
    progress : callable
        Called with the axis, the number done and the total.

    Raises
    ------
    TrimError
        If the aircraft can't be trimmed.
    GtmbenchError
        If no gains are found that hold it.

    Examples
    --------
    It flies for minutes (``gb.find_autopilot("c172x").autopilot``); what it begins with is there at once:

    >>> from gtmbench.bench.modes import linearised
    >>> from gtmbench.bench.tuning import similar_autopilot
    >>> similar = similar_autopilot(linearised("gtm"))
    >>> round(similar.theta_to_elevator, 1), round(similar.phi_to_aileron, 1)
    (0.8, 1.0)
    """
    craft = load_aircraft(aircraft)
    chain = craft.chain_of(sensors)
    found = replace(similar_autopilot(linearised(craft)), lead_s=0.0 if chain is None else lateness_s(chain))
    for done, axis in enumerate(AXES):
        progress(axis, done, len(AXES) + 1)
        if any(getattr(found, gain) for gain in AXES[axis]):  # without a rudder there is no yaw damper
            found = _best(craft, found, axis, chain)
    progress("ten minutes of turbulence", len(AXES), len(AXES) + 1)
    flight = _flown(craft, chain, found, _PROVED_S, seed=2)
    if flight is None or flight.departed_s is not None:
        raise GtmbenchError(
            f"no gains are found that hold '{craft.name}' in moderate turbulence at {craft.altitude_ft:g} ft and "
            f"{craft.tas_kt:g} kt; try another condition, or write [autopilot] by hand"
        )
    truth = flight.truth
    return Tuned(
        autopilot=found,
        altitude_off_ft=_most_off(truth, "altitude"),
        tas_off_kt=_most_off(truth, "tas"),
        bank_deg=float(np.abs(truth["phi"]).max()),
        rates_deg_s={name: float(np.std(truth[name])) for name in GYROS},
        delay_margin_s=delay_margin_s(craft, found, chain),
    )


def lateness_s(chain: SensorChain) -> float:
    """Return how late the slowest gyro of a chain is: its delay, its filter's, and half of its sample's hold.

    >>> from gtmbench.bench.sensor_chain import SensorPath
    >>> lateness_s(SensorChain(paths={"q": SensorPath(delay_s=0.015, rate_hz=50.0)}))
    0.025
    """
    paths = [path for name in GYROS if (path := chain.paths.get(name))]
    late = [
        path.delay_s
        + (1.0 / (2.0 * math.pi * path.filter_hz) if path.filter_hz else 0.0)
        + (0.5 / path.rate_hz if path.rate_hz else 0.0)
        for path in paths
    ]
    return _rounded(max(late, default=0.0))


def delay_margin_s(craft: Aircraft, autopilot: Autopilot, chain: SensorChain | None) -> float:
    """Return by how much later gyros and angles may come, in steps of 5 ms up to 0.1 s, until a flight is lost."""
    own = SensorChain() if chain is None else chain
    alone = _flown(craft, own, autopilot, _MARGIN_S, seed=3)
    if alone is None or alone.departed_s is not None:
        return 0.0
    usual = {name: float(np.std(alone.truth[name])) for name in GYROS}
    for step in range(1, _MARGIN_STEPS + 1):
        flight = _flown(craft, _later(own, step * _MARGIN_STEP_S), autopilot, _MARGIN_S, seed=3)
        if flight is None or flight.departed_s is not None:
            return (step - 1) * _MARGIN_STEP_S
        if any(float(np.std(flight.truth[name])) > 2.0 * rms for name, rms in usual.items()):
            return (step - 1) * _MARGIN_STEP_S
    return _MARGIN_STEPS * _MARGIN_STEP_S


def _later(chain: SensorChain, more_s: float) -> SensorChain:
    paths = {name: chain.paths.get(name, SensorPath()) for name in (*GYROS, *ATTITUDE)}
    late = {name: replace(path, delay_s=path.delay_s + more_s) for name, path in paths.items()}
    return SensorChain(paths={**chain.paths, **late})


def _most_off(truth: Record, channel: str) -> float:
    return float(np.abs(truth[channel] - truth[channel][0]).max())


def similar_autopilot(linear: LinearModel) -> Autopilot:
    """Return gains that are to an aircraft's motion what the GTM's are to its own.

    Where the rudder moves nothing its gain is 0: there is no yaw damper. Where the throttle does nothing, altitude and
    speed aren't held: the attitude of the descent is.
    """
    state, moved = linear.state_matrix, linear.input_matrix
    w, p, q, r, v = (STATES.index(name) for name in ("w", "p", "q", "r", "v"))
    effect = {
        "elevator": math.degrees(moved[q, 0]),
        "aileron": math.degrees(_roll_effect(linear)),
        "rudder": math.degrees(moved[r, 2]),
        "throttle": moved[STATES.index("u"), 3],
    }
    for name in ("elevator", "aileron"):
        if not abs(effect[name]) > _NO_EFFECT:
            raise TrimError(f"no gains: the {name} moves nothing at this trim")
    pitch, yaw = (math.sqrt(abs(float(np.linalg.det(state[np.ix_(pair, pair)])))) for pair in ((w, q), (v, r)))  # rad/s
    roll, speed = abs(state[p, p]), math.sqrt(2.0) * G_FT_S2 / linear.speed_ft_s
    climb_ft_s_deg = math.radians(linear.speed_ft_s)  # what 1 deg of path is
    gains = {
        "q_to_elevator_s": -4.36 * pitch / effect["elevator"],
        "theta_to_elevator": -0.755 * pitch**2 / effect["elevator"],
        "p_to_aileron_s": -2.71 * roll / effect["aileron"],
        "phi_to_aileron": -1.636 * roll**2 / effect["aileron"],
        "psi_to_phi": 0.0228 * roll * linear.speed_ft_s / G_FT_S2,
        "washout_s": 13.6 / yaw,
    }
    if abs(effect["rudder"]) > _NO_EFFECT:
        gains["r_to_rudder_s"] = -4.77 * yaw / effect["rudder"]
    if abs(effect["throttle"]) > _NO_EFFECT:
        climbs = 0.077 * pitch / climb_ft_s_deg
        pushes = 1.27 * speed * FT_S_PER_KT / effect["throttle"]
        gains |= {
            "altitude_to_theta_deg_ft": climbs,
            "altitude_integral_deg_ft_s": climbs * 0.0065 * pitch,
            "tas_to_throttle_percent_kt": pushes,
            "tas_integral_percent_kt_s": pushes * 0.373 * speed,
        }
    return Autopilot(**{name: _rounded(gain) for name, gain in gains.items()})


def _roll_effect(linear: LinearModel) -> float:
    """Return what the aileron does to the roll acceleration, in rad/s2 by deg.

    Where it yaws more than it rolls (two-axis models steer by the rudder, through the dihedral) the roll rate that it
    settles at has the other sign: then that decides, as the acceleration which the roll damping would balance.
    """
    v, p, r = (STATES.index(name) for name in ("v", "p", "r"))
    at_once = float(linear.input_matrix[p, 1])
    damping = linear.state_matrix[np.ix_((v, p, r), (v, p, r))]
    try:
        settled = -np.linalg.solve(damping, linear.input_matrix[[v, p, r], 1])
    except np.linalg.LinAlgError:
        return at_once
    balanced = -float(settled[1]) * linear.state_matrix[p, p]
    return balanced if at_once * balanced < 0.0 else at_once


def _rounded(gain: float) -> float:
    return float(f"{gain:.3g}")


def _best(craft: Aircraft, found: Autopilot, axis: str, chain: SensorChain | None = None) -> Autopilot:
    """Return the gains of which the worst among themselves, half and twice of an axis does best."""
    tried = [_scaled(found, axis, 2.0**octave) for octave in OCTAVES]
    costs = [_cost(craft, autopilot, chain) for autopilot in tried]
    worst = [max(costs[i - 1 : i + 2]) for i in range(1, len(costs) - 1)]
    return tried[1 + int(np.argmin(worst))] if np.isfinite(worst).any() else found


def _scaled(autopilot: Autopilot, axis: str, factor: float) -> Autopilot:
    return replace(autopilot, **{name: _rounded(factor * getattr(autopilot, name)) for name in AXES[axis]})


def _cost(craft: Aircraft, autopilot: Autopilot, chain: SensorChain | None = None) -> float:
    """Return how badly an aircraft is held in turbulence: 1 where everything is at what is tolerated."""
    flight = _flown(craft, chain, autopilot, _TRIED_S, seed=1)
    if flight is None or flight.departed_s is not None:
        return math.inf
    truth = flight.truth
    tolerated = {name: most for name, most in _TOLERATED.items() if name != "altitude" or not craft.motorless}
    held = [np.sqrt(np.mean((truth[name] - truth[name][0]) ** 2)) / most for name, most in tolerated.items()]
    spans = {name: high - low for name, (low, high) in craft.limits.items()}
    moved = [np.std(truth[name]) / (_MOVED * spans[name]) for name in COMMANDS]
    return float(np.sqrt(np.mean(np.square(held + moved))))


def _flown(
    craft: Aircraft, chain: SensorChain | None, autopilot: Autopilot, duration_s: float, seed: int
) -> LoopFlight | None:
    """Return a flight in turbulence, or None where it leaves the envelope."""
    try:
        return fly_in_loop(
            craft, "turbulence", duration_s, seed, autopilot=autopilot, sensors=IDEAL if chain is None else chain
        )
    except EnvelopeError:
        return None
