"""What vibrates, by its modes, sampled without error: the plate of section 4.5 and the drum of section 4.6."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray, Record, frozen
from theory.state_space import ComplexArray, StateSpace

_Ends = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes:
    """q_i'' + 2 zeta w_i q_i' + s_i w_i^2 q_i = sum over j of driven_ij u_j, y = heard q.

    s_i is 1 unless `simulate` is told how the stiffness changes; the dampers stay what they are.

    Attributes
    ----------
    omega : shape (modes,)
        w, natural frequencies in rad/s.
    damping : float
        zeta, the same for every mode.
    driven : shape (modes, inputs)
        What a unit of force j does to mode i.
    heard : shape (outputs, modes)
        What a sensor has of mode i.
    """

    omega: FloatArray
    damping: float
    driven: FloatArray = field(repr=False)
    heard: FloatArray = field(repr=False)

    @property
    def frequency_hz(self) -> FloatArray:
        """Natural frequencies, w / 2 pi."""
        return np.asarray(self.omega / (2.0 * np.pi))

    @property
    def rate(self) -> FloatArray:
        """How fast the modes die away: zeta w, in 1/s."""
        return np.asarray(self.damping * self.omega)


@dataclass(frozen=True, kw_only=True, eq=False)
class Held:
    """Forces that stay what they are from one sample to the next, shape (samples, inputs)."""

    values: FloatArray = field(repr=False)

    def __len__(self) -> int:
        return len(self.values)

    def steady(self, modes: Modes, squared: FloatArray, _period: float) -> _Ends:
        """Return (q, q') at both ends of every interval, had its forces acted for ever on its stiffness."""
        q = self.values @ modes.driven.T / squared
        still = np.stack([q, np.zeros_like(q)], axis=-1)
        return still, still


@dataclass(frozen=True, kw_only=True, eq=False)
class Sinusoids:
    """Forces u_j(t) = amplitude_j sin(omega_j t) from t = 0 on, also between the samples."""

    amplitude: FloatArray
    omega: FloatArray
    samples: int

    def __len__(self) -> int:
        return self.samples

    def response(self, modes: Modes, squared: FloatArray) -> ComplexArray:
        """Return the modes' complex amplitudes by force, shape (..., modes, inputs), from s w^2 (..., modes)."""
        dynamic = squared[..., np.newaxis] - self.omega**2 + 2j * modes.rate[:, np.newaxis] * self.omega
        return np.asarray(modes.driven * self.amplitude / dynamic)

    def steady(self, modes: Modes, squared: FloatArray, period: float) -> _Ends:
        """Return (q, q') at both ends of every interval, had its forces acted for ever on its stiffness."""
        position = self.response(modes, squared)
        turns = np.exp(1j * period * np.outer(np.arange(self.samples + 1), self.omega))[:, np.newaxis]
        moved = np.stack([position, 1j * self.omega * position], axis=-2)  # samples, modes, (q, q'), inputs
        begin, end = (np.sum(moved * at[:, np.newaxis], axis=-1).imag for at in (turns[:-1], turns[1:]))
        return begin, end


def modes_of(mass: ArrayLike, stiffness: ArrayLike, *, forces: ArrayLike, sensors: ArrayLike, damping: float) -> Modes:
    """Return the modes of M q'' + K q = forces u, y = sensors q, damped by a share of the critical damping.

    Parameters
    ----------
    mass, stiffness : array_like, shape (n, n)
        M and K, symmetric and positive definite.
    forces, sensors : array_like, shapes (n, inputs), (outputs, n)
    damping : float
        zeta.

    Examples
    --------
    >>> modes_of([[2.0]], [[8.0]], forces=[[1.0]], sensors=[[1.0]], damping=0.01).omega
    array([2.])
    """
    M, K = frozen(mass), frozen(stiffness)
    units = 1.0 / np.sqrt(np.diag(M))  # polynomials of any degree then weigh the same, which keeps digits
    try:
        squared, shapes = scipy.linalg.eigh(units[:, np.newaxis] * K * units, units[:, np.newaxis] * M * units)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise InputError(f"no modes: {error}; mass must be symmetric and positive definite") from error
    if not squared[0] > 0.0:
        raise InputError(f"the stiffness has an eigenvalue of {squared[0]:.3g}; what isn't held has no modes")
    shapes = units[:, np.newaxis] * shapes
    return Modes(
        omega=frozen(np.sqrt(squared)),
        damping=number("damping", damping, 0.0),
        driven=frozen(shapes.T @ frozen(forces)),
        heard=frozen(frozen(sensors) @ shapes),
    )


def simulate(
    modes: Modes, excitation: Held | Sinusoids, *, sample_period_s: float, stiffness: ArrayLike = 1.0
) -> Record:
    """Return what the sensors hear, from rest, at k Ts: channels y1, y2, ...; no integration error.

    Parameters
    ----------
    modes : Modes
    excitation : Held or Sinusoids
        As many samples are returned as it has.
    sample_period_s : float
    stiffness : array_like, broadcast to (samples, modes)
        s_i: by what the stiffness is multiplied from sample k to k + 1. Position and velocity go on where it changes.

    Raises
    ------
    InputError
        Where a mode doesn't oscillate.

    Examples
    --------
    >>> mode = modes_of([[1.0]], [[4.0 * np.pi**2]], forces=[[1.0]], sensors=[[4.0 * np.pi**2]], damping=0.0)
    >>> simulate(mode, Held(values=np.ones((3, 1))), sample_period_s=0.5)["y1"].round(9) + 0.0
    array([0., 2., 0.])
    """
    period = number("sample_period_s", sample_period_s, 0.0, above=True)
    squared = np.broadcast_to(np.asarray(stiffness, dtype=np.float64), (len(excitation), len(modes.omega)))
    squared = squared * modes.omega**2
    turns = _turns(modes, squared, period)
    begin, end = excitation.steady(modes, squared, period)
    pushes = end - (turns @ begin[..., np.newaxis])[..., 0]
    states = np.empty_like(pushes)
    now = np.zeros(pushes.shape[1:])
    for k, (turn, push) in enumerate(zip(turns, pushes, strict=True)):
        states[k] = now
        now = (turn @ now[:, :, np.newaxis])[:, :, 0] + push
    return Record(
        states[:, :, 0] @ modes.heard.T,
        channels=[f"y{i + 1}" for i in range(len(modes.heard))],
        sample_period_s=period,
    )


def unforced(modes: Modes, excitation: Sinusoids, *, sample_period_s: float) -> tuple[StateSpace, FloatArray]:
    """Return the system without inputs that makes the same samples, and its state at rest.

    Its A has one rotation, shrunk, for every mode and one for every sinusoid: the sensors are sums of so many pairs of
    exponentials.

    Examples
    --------
    >>> mode = modes_of([[1.0]], [[9.0]], forces=[[1.0]], sensors=[[1.0]], damping=0.1)
    >>> wave = Sinusoids(amplitude=np.ones(1), omega=np.ones(1), samples=50)
    >>> system, start = unforced(mode, wave, sample_period_s=0.1)
    >>> expected = simulate(mode, wave, sample_period_s=0.1).values
    >>> system, np.allclose(system.simulate(np.zeros((50, 0)), start), expected)
    (StateSpace(4 states, 1 x 0), True)
    """
    own = _turns(modes, modes.omega**2, sample_period_s)
    angle = excitation.omega * sample_period_s
    waves = np.moveaxis(np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]), -1, 0)
    position = excitation.response(modes, modes.omega**2)
    forced = modes.heard @ position
    begin = np.stack([position.imag.sum(axis=1), (1j * excitation.omega * position).imag.sum(axis=1)], axis=-1)
    outputs, count = modes.heard.shape
    system = StateSpace(
        A=scipy.linalg.block_diag(*own, *waves),
        B=np.zeros((2 * (count + len(angle)), 0)),
        C=np.hstack([np.kron(modes.heard, [1.0, 0.0]), np.stack([forced.real, forced.imag], -1).reshape(outputs, -1)]),
        D=np.zeros((outputs, 0)),
    )
    return system, np.concatenate([-begin.ravel(), np.tile([0.0, 1.0], len(angle))])


def measured(record: Record, *, snr: float, seed: int | tuple[int, ...]) -> Record:
    """Return the record with white Gaussian noise on every channel; its RMS about the mean is `snr` times the noise's.

    Examples
    --------
    >>> record = Record(np.sin(np.arange(5000)), channels=["y1"], sample_period_s=1.0)
    >>> noise = measured(record, snr=10, seed=1)["y1"] - record["y1"]
    >>> round(float(record["y1"].std() / noise.std()), 1)
    10.0
    """
    noise = np.random.default_rng(seed).standard_normal(record.values.shape)
    values = record.values + noise * record.values.std(axis=0) / number("snr", snr, 0.0, above=True)
    return Record(values, channels=record.channels, sample_period_s=record.sample_period_s, start_s=record.start_s)


def _turns(modes: Modes, squared: FloatArray, period: float) -> FloatArray:
    """Return what a sample period makes of (q, q') without forces, shape (*squared.shape, 2, 2)."""
    rate = modes.rate
    if not np.all(squared > rate**2):
        raise InputError("a mode doesn't oscillate: it needs a stiffness above nil and a damping below 1")
    damped = np.sqrt(squared - rate**2)
    decay = np.exp(-rate * period)
    cosine, sine = decay * np.cos(damped * period), decay * np.sin(damped * period) / damped
    rows = [[cosine + rate * sine, sine], [-squared * sine, cosine - rate * sine]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))
