"""A Kalman filter on the aircraft's linear model with known commands: its innovations, one a gyro.

Source: G. Heredia and A. Ollero, Detection of sensor faults in small helicopter UAVs using observer/Kalman filter
identification, Mathematical Problems in Engineering 2011, doi:10.1155/2011/174618, whose Table 5 compares a filter that
is tuned well with one whose parameters are off by 20 %, which misses some drifts. The model is identified by equation
error, V. Klein and E. A. Morelli, Aircraft System Identification, AIAA 2006, chapter 5, doi:10.2514/4.861505; its noise
is tuned by the likelihood of the innovations on healthy flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from gtmbench.detectors.rivals.rival import Model, Rival
from gtmbench.detectors.rivals.signals import Generator, Scale
from gtmbench.values.channels import COMMANDS, GYROS
from gtmbench.values.record import FloatArray

STATES = ("p", "q", "r", "alpha", "beta", "tas", "phi", "theta")
FORCES = ("nx", "ny", "nz")
_GROUPS = (slice(0, 3), slice(3, 6), slice(6, 8))  # of states whose noise is tuned together
_KINEMATIC = ((3, 1), (4, 0), (4, 2))  # alpha' by q, beta' by p and r: no aerodynamics in these
_SMOOTHED_S, _DEGREE = 0.3, 3  # of states, before they are differentiated
_THINNED = 3  # rows: equations of every third are fitted, for neighbours say the same
_AVERAGED_S = 0.5  # equation errors, before they are taken for white noise
_TUNED_S, _BEGUN_S = 60.0, 5.0  # of a flight; its beginning is left out
_STEPS = (3.0, 1.5, 0.7)  # of logarithms of noise


@dataclass(frozen=True, kw_only=True)
class LinearKalmanFilter(Rival):
    """e(k) = y(k) - C x(k|k-1), x of the motion about trim, the servos and known commands.

    Parameters
    ----------
    servo_rad_s : float
        Bandwidth of the servos; the GTM's is 5 Hz.
    parameter_error : float
        By what share every aerodynamic coefficient is off, up or down by chance.
    """

    name: str = "kalman"
    servo_rad_s: float = 31.4
    parameter_error: float = 0.0
    settles_s: ClassVar[float] = 10.0
    channels: ClassVar[tuple[str, ...]] = (*STATES, *FORCES, *COMMANDS)

    @property
    def title(self) -> str:
        """What it is, in a line."""
        off = f", its parameters off by {100 * self.parameter_error:g} %" if self.parameter_error else ""
        return f"Kalman filter on an identified linear model with commands{off}"

    def fit(self, records: Sequence[FloatArray], sample_period_s: float) -> Model:
        """Return transition, command, output and gain matrices, and what readings and commands are about."""
        found = _identified(records, sample_period_s, self.servo_rad_s)
        if self.parameter_error:
            found = _erring(found, self.parameter_error)
        system = _discrete(found, sample_period_s, self.servo_rad_s)
        readings = _about(records[0][: round(_TUNED_S / sample_period_s)], found)
        gain = _tuned(system, found, *readings, round(_BEGUN_S / sample_period_s))
        return {
            "transition": system.transition,
            "command": system.command,
            "output": system.output,
            "gain": gain,
            "mean": np.concatenate([found.mean, found.command_mean]),
        }

    def generator(self, model: Model, sample_period_s: float) -> Generator:
        """Return what filters."""
        return _Filter(model)


class _Found(NamedTuple):
    """x' = A x + B u, y = C x + D u about means; what the equations leave, and the sensors' noise."""

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray
    mean: FloatArray
    command_mean: FloatArray
    intensity: FloatArray  # of the equations' errors, as white noise
    noise: FloatArray  # variances of the readings


class _System(NamedTuple):
    """x(k+1) = transition x(k) + command u(k), y = output x; servos are states."""

    transition: FloatArray
    command: FloatArray
    output: FloatArray


def _identified(records: Sequence[FloatArray], period_s: float, servo_rad_s: float) -> _Found:
    """Fit rates of smoothed states, and forces, to states and servos by least squares."""
    from scipy.signal import lfilter, savgol_coeffs, savgol_filter

    states, sensors = len(STATES), len(STATES) + len(FORCES)
    rows = max(round(_SMOOTHED_S / period_s), _DEGREE + 2) | 1
    # Savitzky-Golay: states and their slopes at once, the noise being what smoothing takes away
    share = 1.0 - float(savgol_coeffs(rows, _DEGREE)[rows // 2])  # of white noise, that smoothing leaves over
    regressors, targets, noise = [], [], []
    for values in records:
        whole = values[np.isfinite(values).all(axis=1)]
        smooth = savgol_filter(whole[:, :sensors], rows, _DEGREE, axis=0)
        slope = savgol_filter(whole[:, :states], rows, _DEGREE, deriv=1, delta=period_s, axis=0)
        # a servo is a first-order lag of its command: s(k+1) = pole s(k) + (1 - pole) c(k)
        pole = np.exp(-servo_rad_s * period_s)
        commands = whole[:, sensors:]
        servos = lfilter([0.0, 1.0 - pole], [1.0, -pole], commands - commands[0], axis=0) + commands[0]
        kept = slice(rows, -rows)
        regressors.append(np.column_stack([smooth[kept, :states], servos[kept]]))
        targets.append(np.column_stack([slope[kept], smooth[kept, states:]]))
        noise.append(np.var((whole[:, :sensors] - smooth)[kept], axis=0) / share)
    x, y = np.concatenate(regressors), np.concatenate(targets)
    scale = Scale.of(x)
    equations = np.column_stack([scale.standard(x), np.ones(len(x))])
    # [x' f] = [x servos 1] [A' C'; B' D'; mean], scaled to deviation 1; smoothed rows repeat each other, so some do
    found = np.linalg.lstsq(equations[::_THINNED], y[::_THINNED], rcond=1e-6)[0]
    matrix = found[:-1].T / scale.deviation
    left = y - equations @ found
    block = max(round(_AVERAGED_S / period_s), 1)
    # process noise: of slopes averaged over a block, for what wanders faster is smoothing's and the sensors'
    averaged = left[: len(left) // block * block, :states].reshape(-1, block, states).mean(axis=1)
    return _Found(
        a=matrix[:states, :states],
        b=matrix[:states, states:],
        c=np.vstack([np.eye(states), matrix[states:, :states]]),
        d=np.vstack([np.zeros((states, len(COMMANDS))), matrix[states:, states:]]),
        mean=np.concatenate([scale.mean[:states], found[-1, states:]]),
        command_mean=scale.mean[states:],
        intensity=np.maximum(averaged.var(axis=0) * block * period_s, 1e-12),
        noise=np.mean(noise, axis=0),
    )


def _erring(found: _Found, share: float) -> _Found:
    """Return a model whose aerodynamic coefficients are off."""
    random = np.random.default_rng(1)

    def off(matrix: FloatArray) -> FloatArray:
        return matrix * (1.0 + share * random.choice([-1.0, 1.0], matrix.shape))

    states, a, c = len(STATES), found.a.copy(), found.c.copy()
    a[:6] = off(a[:6])
    for row, column in _KINEMATIC:
        a[row, column] = found.a[row, column]
    c[states:] = off(c[states:])
    return found._replace(a=a, b=off(found.b), c=c, d=off(found.d))


def _discrete(found: _Found, period_s: float, servo_rad_s: float) -> _System:
    from scipy.linalg import expm

    states, commands = found.b.shape
    size = states + commands
    drift = np.zeros((size + commands,) * 2)
    drift[:states, :states], drift[:states, states:size] = found.a, found.b
    drift[states:size, states:size] = -servo_rad_s * np.eye(commands)
    drift[states:size, size:] = servo_rad_s * np.eye(commands)
    step = expm(drift * period_s)
    return _System(step[:size, :size], step[:size, size:], np.hstack([found.c, found.d]))


def _tuned(system: _System, found: _Found, readings: FloatArray, commands: FloatArray, first: int) -> FloatArray:
    """Return the gain whose innovations are likeliest, over the strength of three groups of process noise."""

    def cost(strength: FloatArray) -> tuple[float, FloatArray]:
        try:
            gain, covariance = _gain(system, found, np.exp(strength))
        except (np.linalg.LinAlgError, ValueError):
            return np.inf, np.zeros(0)
        innovations = _run(system, gain, readings, commands, np.zeros(len(system.transition)))[0][first:]
        weighed = np.linalg.solve(covariance, innovations.T)
        power = float(np.sum(innovations.T * weighed)) / len(innovations)
        return power + float(np.linalg.slogdet(covariance)[1]), gain

    at = np.zeros(len(_GROUPS))
    best, gain = cost(at)
    for step in _STEPS:
        for i in range(len(_GROUPS)):
            for way in (-step, step):
                while True:
                    there = at.copy()
                    there[i] += way
                    now, other = cost(there)
                    if not now < best - 1e-4 or abs(there[i]) > 20.0:
                        break
                    at, best, gain = there, now, other
    return gain


def _gain(system: _System, found: _Found, strength: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the steady gain and the innovations' covariance."""
    from scipy.linalg import solve_discrete_are

    period_s = -np.log(system.transition[-1, -1])  # in servo time constants: scales all noise alike
    size = len(system.transition)
    process = np.full(size, 1e-9)
    for group, factor in zip(_GROUPS, strength.tolist(), strict=True):
        process[group] = found.intensity[group] * factor * period_s
    noise = np.diag(found.noise)
    p = solve_discrete_are(system.transition.T, system.output.T, np.diag(process), noise)
    covariance = system.output @ p @ system.output.T + noise
    return np.linalg.solve(covariance, system.output @ p).T, covariance


def _about(values: FloatArray, found: _Found) -> tuple[FloatArray, FloatArray]:
    sensors = len(found.mean)
    whole = values[np.isfinite(values).all(axis=1)]
    return whole[:, :sensors] - found.mean, whole[:, sensors:] - found.command_mean


def _run(
    system: _System, gain: FloatArray, readings: FloatArray, commands: FloatArray, state: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the innovations and the state predicted next; where a reading is missing it only predicts."""
    there = np.asarray(np.isfinite(readings).all(axis=1) & np.isfinite(commands).all(axis=1))
    through = system.transition @ gain
    closed = system.transition - through @ system.output
    driven = np.where(there[:, np.newaxis], readings, 0.0) @ through.T
    driven += np.where(np.isfinite(commands), commands, 0.0) @ system.command.T
    states = np.empty((len(readings), len(state)))
    for k, (drive, known) in enumerate(zip(driven, there.tolist(), strict=True)):
        states[k] = state
        state = (closed if known else system.transition) @ state + drive
    return readings - states @ system.output.T, state


class _Filter:
    """The steady filter, a row at a time."""

    def __init__(self, model: Model) -> None:
        self._system = _System(model["transition"], model["command"], model["output"])
        self._gain, self._mean = model["gain"], model["mean"]
        self._state = np.zeros(len(self._system.transition))

    def push(self, values: FloatArray) -> FloatArray:
        """Return the gyros' innovations of the next rows."""
        about, sensors = values - self._mean, len(self._system.output)
        innovations, self._state = _run(self._system, self._gain, about[:, :sensors], about[:, sensors:], self._state)
        return innovations[:, : len(GYROS)]
