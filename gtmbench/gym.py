"""Gymnasium: an aircraft whose flight is an episode, ``gymnasium.make("gtmbench/GTM-v0")`` once this is imported.

A policy is a controller that sees what the sensors read, faults included, and is rewarded by the truth. It holds
altitude, heading and speed at a target. `GtmEnv` says what it observes, what it commands and when an episode ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.bench.aircraft import Aircraft
from gtmbench.bench.excitation import Excitation
from gtmbench.bench.sensor_chain import IDEAL, SensorChain
from gtmbench.bench.sensor_readings import Readings
from gtmbench.bench.simulation import Simulation
from gtmbench.checks import keys, number, shown, table_of, whole
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.values.attitude_estimators import OWN, AttitudeEstimator
from gtmbench.values.channels import COMMANDS, SENSORS
from gtmbench.values.record import Span

try:
    import gymnasium
except ImportError as error:
    raise ImportError("gtmbench.gym needs the package gymnasium; pip install 'gtmbench[gym]'") from error

ID = "gtmbench/GTM-v0"
TARGETS = ("altitude_ft", "psi_deg", "tas_kt")
Faults = Fault | Sequence[Fault] | Callable[[np.random.Generator], Fault | Sequence[Fault]]
# what is 1 in an observation: deg/s, deg, g, kt, ft
_UNITS = {
    **dict.fromkeys(("p", "q", "r"), 20.0),
    **dict.fromkeys(("alpha", "beta"), 10.0),
    **dict.fromkeys(("phi", "theta", "psi"), 30.0),
    **dict.fromkeys(("nx", "ny", "nz"), 1.0),
    "tas": 20.0,
    "altitude": 100.0,
}
_TARGET_OF = {"altitude": "altitude_ft", "psi": "psi_deg", "tas": "tas_kt"}
_TOLERATED = {"altitude": 50.0, "psi": 10.0, "tas": 10.0}  # ft, deg, kt: the reward's standard deviations
_MOST = 10.0  # of an observation
_SHARE = 0.5  # of a command's way from trim to its nearer limit: what an action of 1 is
_SEEDS = 2**31  # of flights: as many as are drawn from


class GtmEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """Hold altitude, heading and speed, on sensors that may break.

    **Observation**, 13 numbers: the readings in the order of `Readings`, less what they are in trim at the target, over
    20 deg/s (p, q, r), 10 deg (alpha, beta), 30 deg (phi, theta, psi), 1 g, 20 kt and 100 ft, within +-10. A missing
    reading is the last one.

    **Action**, 4 numbers within +-1: elevator, aileron, rudder and throttle from trim, 1 being half of the way to the
    nearer limit.

    **Reward** a step: exp(-(e_h^2 + e_psi^2 + e_V^2)/2) of the true errors over 50 ft, 10 deg and 10 kt; at most 1.

    **The end**: terminated where the aircraft departs (``[departure]`` of its facts); truncated where it leaves the
    envelope of its model, an estimator's theta passes 85 deg, or the time is over. ``info["end"]`` says which.

    Parameters
    ----------
    aircraft, excitation, duration_s, noise, attitude, sensors
        As `Simulation` takes them; by default 60 s in turbulence on ideal sensors. ``sensors="chain"`` gives a policy
        what the GTM's own autopilot flies on.
    faults : Fault, sequence of Fault or function, optional
        The faults of every episode. A function gets the environment's random generator and returns the faults.
    targets : mapping, optional
        ``altitude_ft``, ``psi_deg`` and ``tas_kt``, each a number or a span [low, high] in which every episode draws
        one, relative to trim. By default 0: what it was trimmed at.
    samples_a_step : int
        How many samples of 0.01 s a command holds.

    Attributes
    ----------
    simulation : Simulation
        What flies: its truth, its `switch_on`, and ``flight()``, the records of the episode.
    tracked : dict
        What this episode holds, by channel: altitude in ft, psi in deg, tas in kt, and the trim's attitude.

    Notes
    -----
    ``reset(options=...)`` takes `faults` and `targets` for one episode.

    Examples
    --------
    >>> import gymnasium
    >>> import gtmbench as gb
    >>> import gtmbench.gym
    >>> env = gymnasium.make("gtmbench/GTM-v0", duration_s=2.0, faults=gb.Jam(channel="q", onset_s=1.0))
    >>> observation, info = env.reset(seed=1)
    >>> ended = False
    >>> while not ended:
    ...     observation, reward, terminated, truncated, info = env.step(env.action_space.sample() * 0.0)
    ...     ended = terminated or truncated
    >>> info["end"], observation.shape, env.unwrapped.simulation.flight().truth.end_s
    ('duration', (13,), 2.0)
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  as Gymnasium has it

    def __init__(
        self,
        aircraft: str | Path | Aircraft = "gtm",
        excitation: str | Excitation = "turbulence",
        duration_s: float = 60.0,
        *,
        faults: Faults = (),
        targets: dict[str, float | Span] | None = None,
        noise: str | None = "t2",
        attitude: str | AttitudeEstimator = OWN,
        sensors: str | SensorChain = IDEAL,
        samples_a_step: int = 2,
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None:
            raise InputError(f"render_mode is {shown(render_mode)}; there is none: see a flight by its recording")
        self.render_mode = None
        self.simulation = Simulation(aircraft, excitation, duration_s, noise=noise, attitude=attitude, sensors=sensors)
        self._samples = whole("samples_a_step", samples_a_step, 1, 100)
        self._faults = faults
        self._targets = dict.fromkeys(TARGETS, (0.0, 0.0)) | _checked_targets(targets or {})
        self._departure = self.simulation.aircraft.departure
        self.tracked: dict[str, float] = {}
        self.observation_space = gymnasium.spaces.Box(-_MOST, _MOST, (len(SENSORS),), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (len(COMMANDS),), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode: in trim, with other air, noise, faults and targets.

        Parameters
        ----------
        seed : int, optional
            Of all that is random from now on; without one the generator goes on.
        options : dict, optional
            ``faults`` and ``targets`` of this episode, instead of the environment's.

        Raises
        ------
        InputError
            If an option is unknown or invalid.
        TrimError
            If the aircraft can't be trimmed.
        """
        super().reset(seed=seed)
        told = keys(dict(options or {}), ("faults", "targets"), section="options")
        random = self.np_random
        flight_seed = int(random.integers(_SEEDS))
        faults = told.get("faults", self._faults)
        readings = self.simulation.reset(flight_seed, faults=faults(random) if callable(faults) else faults)
        trim = self.simulation.trim
        targets = self._targets | _checked_targets(told.get("targets", {}))
        shifts = {name: float(random.uniform(*targets[name])) for name in TARGETS}
        trimmed = {
            "alpha": trim.alpha_deg,
            "phi": trim.roll_deg,
            "theta": trim.pitch_deg,
            "psi": trim.yaw_deg,
            "nz": 1.0,
            "tas": trim.tas_kt,
            "altitude": trim.altitude_ft,
        }
        self.tracked = {name: value + shifts.get(_TARGET_OF.get(name, ""), 0.0) for name, value in trimmed.items()}
        self._centre = np.array([self.tracked.get(name, 0.0) for name in SENSORS])
        self._level = np.array(list(trim.commands.values()))
        limits = np.array([self.simulation.aircraft.limits[name] for name in COMMANDS])
        self._span = _SHARE * np.abs(limits - self._level[:, None]).min(axis=1)
        self._seen = self._centre
        return self._observed(readings), {"faults": self._said_faults(), "targets": {**shifts}}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Command, and fly on by `samples_a_step` samples.

        Raises
        ------
        InputError
            If the action isn't four finite numbers, or the episode is over.
        """
        simulation = self.simulation
        moved = np.asarray(action, dtype=np.float64)
        if moved.shape != (len(COMMANDS),):
            raise InputError(f"action is {shown(action)}; give {len(COMMANDS)} numbers within -1..1")
        commands = (self._level + self._span * np.clip(moved, -1.0, 1.0)).tolist()
        for _ in range(self._samples):
            readings = simulation.step(commands)
            if simulation.is_over:
                break
        truth = simulation.truth
        terminated = any(not low <= truth[name] <= high for name, (low, high) in self._departure.items())
        info = {"end": "departure" if terminated else simulation.end} if terminated or simulation.is_over else {}
        return self._observed(readings), self._reward(truth), terminated, simulation.is_over and not terminated, info

    def action_of(self, commands: Sequence[float]) -> NDArray[np.float32]:
        """Return the action that commands these, in deg and percent, as far as actions reach.

        By it a controller of yours, or an autopilot, flies in this environment.
        """
        action: NDArray[np.float32] = np.clip((np.array(commands) - self._level) / self._span, -1.0, 1.0).astype("f4")
        return action

    def _observed(self, readings: Readings) -> NDArray[np.float32]:
        values = np.array(readings)
        missing = np.isnan(values)
        if missing.any():
            values = np.where(missing, self._seen, values)
        self._seen = values
        observed: NDArray[np.float32] = np.clip((values - self._centre) / _SCALES, -_MOST, _MOST).astype("f4")
        return observed

    def _reward(self, truth: dict[str, float]) -> float:
        squares = sum(((truth[name] - self.tracked[name]) / _TOLERATED[name]) ** 2 for name in _TOLERATED)
        return math.exp(-0.5 * squares) if squares == squares else 0.0

    def _said_faults(self) -> list[str]:
        return [f"{fault.kind} of {fault.channel} at {fault.onset_s:g} s" for fault in self.simulation.faults]


_SCALES = np.array([_UNITS[name] for name in SENSORS])


def _checked_targets(targets: object) -> dict[str, Span]:
    """Return the span of every target that is given, relative to trim."""
    spans: dict[str, Span] = {}
    for name, given in keys(table_of("targets", targets), TARGETS, section="targets").items():
        low, high = given if isinstance(given, Sequence) and len(given) == 2 else (given, given)
        spans[name] = number(f"targets.{name}", low), number(f"targets.{name}", high)
        if spans[name][0] > spans[name][1]:
            raise InputError(f"targets.{name} is {shown(given)}; the first must not be more than the second")
    return spans


gymnasium.register(id=ID, entry_point="gtmbench.gym:GtmEnv")
