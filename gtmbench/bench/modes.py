"""The linear modes about trim: natural frequency and damping of short period, phugoid, dutch roll, roll and spiral."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtmbench.bench.aircraft import Aircraft
from gtmbench.bench.autopilot import Trim
from gtmbench.bench.engine import set_condition
from gtmbench.bench.equilibrium import trimmed_engine
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.values.channels import CHANNELS, COMMANDS
from gtmbench.values.record import FloatArray

STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta")  # ft/s, rad/s, rad
_STEPS = np.array([0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-3, 1e-4, 1e-4])  # of the states, for slopes: ft/s, then rad/s and rad
_COMMAND_STEPS = np.array([0.1, 0.1, 0.1, 1.0])  # deg, percent
# by (lateral, oscillatory), fastest first; enough names for any conventional or odd aircraft of eight states
_NAMES = {
    (False, True): ["short period", "phugoid", "third longitudinal pair", "fourth longitudinal pair"],
    (True, True): ["dutch roll", "lateral phugoid", "third lateral pair", "fourth lateral pair"],
    (True, False): ["roll", "spiral", *(f"lateral mode {i}" for i in range(3, 9))],
    (False, False): [f"longitudinal mode {i}" for i in range(1, 9)],
}
_LATERAL = np.array([False, True, False, True, False, True, True, False])


@dataclass(frozen=True, kw_only=True)
class Mode:
    """One mode: an eigenvalue (the upper one of a pair) with its natural frequency and damping ratio.

    ``time_constant_s`` is -1/Re of the eigenvalue: negative if the mode grows.

    Examples
    --------
    >>> import gtmbench as gb
    >>> short_period = gb.modes("gtm")[0]
    >>> short_period.name, round(short_period.natural_frequency_rad_s, 1), round(short_period.damping, 2)
    ('short period', 7.7, 0.43)
    """

    name: str
    real_1_s: float
    imag_1_s: float
    natural_frequency_rad_s: float
    damping: float
    time_constant_s: float


def modes(
    aircraft: str | Path | Aircraft = "gtm", *, altitude_ft: float | None = None, tas_kt: float | None = None
) -> list[Mode]:
    """Return the modes of an aircraft about its trim, fastest first.

    The eigenvalues of the state matrix of u, v, w, p, q, r, phi and theta, by central differences of the nonlinear
    model; surfaces, engines and altitude stand still. Another condition than the aircraft's own as for `trim`.

    Parameters
    ----------
    aircraft : str, Path or Aircraft
        As `trim` takes it.
    altitude_ft, tas_kt : float, optional
        Another trim condition than the aircraft's own.

    Raises
    ------
    TrimError
        If the aircraft can't be trimmed.

    Examples
    --------
    >>> import gtmbench as gb
    >>> [mode.name for mode in gb.modes("gtm")]
    ['short period', 'roll', 'dutch roll', 'phugoid', 'spiral']
    """
    linear = linearised(aircraft, altitude_ft=altitude_ft, tas_kt=tas_kt)
    values, vectors = np.linalg.eig(linear.state_matrix)
    lateral = _lateral(vectors, linear.speed_ft_s)
    fastest_first = [i for i in np.argsort(-np.abs(values)) if values[i].imag >= 0]
    names = {kind: iter(known) for kind, known in _NAMES.items()}
    kinds = {i: (bool(lateral[i]), bool(values[i].imag > 0)) for i in fastest_first}
    return [_mode(next(names[kinds[i]], "another"), values[i]) for i in fastest_first]


def _lateral(vectors: np.ndarray, speed_ft_s: float) -> np.ndarray:
    """Return for every mode whether it lies mostly in v, p, r and phi; velocities count as angles."""
    weight = np.abs(vectors) ** 2
    weight[:3] /= speed_ft_s**2
    return np.asarray(weight[_LATERAL].sum(axis=0) > weight[~_LATERAL].sum(axis=0))


def _mode(name: str, value: complex) -> Mode:
    return Mode(
        name=name,
        real_1_s=float(value.real),
        imag_1_s=float(value.imag),
        natural_frequency_rad_s=float(abs(value)),
        damping=float(-value.real / abs(value)),
        time_constant_s=float(-1.0 / value.real),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel:
    """An aircraft about its trim: x' = A x + B u, in ft/s, rad/s and rad.

    Attributes
    ----------
    state_matrix : array, shape (8, 8)
        A, in the order of `STATES`.
    input_matrix : array, shape (8, 4)
        B, by the commands in the order of `COMMANDS`, per deg and per percent; servos and engines have settled.
    trim : Trim
        What it is about.

    Examples
    --------
    >>> import gtmbench as gb
    >>> model = gb.linearised("gtm")
    >>> model.state_matrix.shape, model.input_matrix.shape, round(model.speed_ft_s)
    ((8, 8), (8, 4), 170)
    """

    state_matrix: FloatArray
    input_matrix: FloatArray
    trim: Trim

    @property
    def speed_ft_s(self) -> float:
        """The airspeed."""
        return self.trim.tas_kt / CHANNELS["tas"].scale


def linearised(
    aircraft: str | Path | Aircraft = "gtm", *, altitude_ft: float | None = None, tas_kt: float | None = None
) -> LinearModel:
    """Return the linear model of an aircraft about its trim, by central differences of the nonlinear one.

    The states are u, v and w in ft/s, p, q and r in rad/s, phi and theta in rad; the inputs elevator, aileron and
    rudder in deg, throttle in percent. Surfaces and engines follow at once; altitude and heading stand still.

    Parameters
    ----------
    aircraft, altitude_ft, tas_kt
        As `trim` takes them.

    Raises
    ------
    TrimError
        If the aircraft can't be trimmed.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> model = gb.linearised("gtm")
    >>> bool(np.isin(gb.modes("gtm")[0].real_1_s, np.linalg.eigvals(model.state_matrix).real))
    True
    """
    craft = load_aircraft(aircraft)
    fdm, at = trimmed_engine(craft, altitude_ft=altitude_ft, tas_kt=tas_kt)
    speed = at.tas_kt / CHANNELS["tas"].scale
    alpha, phi, theta = np.deg2rad([at.alpha_deg, at.roll_deg, at.pitch_deg])
    commands = list(at.commands.values())
    trimmed = np.array([speed * np.cos(alpha), 0.0, speed * np.sin(alpha), 0.0, 0.0, 0.0, phi, theta, *commands])
    fixed = {"altitude": at.altitude_ft, "psi": at.yaw_deg}

    def derivative(point: FloatArray) -> FloatArray:
        u, v, w, p, q, r, phi, theta = point[: len(STATES)]
        v_total = float(np.sqrt(u * u + v * v + w * w))
        degrees = {
            "alpha": np.arctan2(w, u),
            "beta": np.arcsin(v / v_total),
            "phi": phi,
            "theta": theta,
            "p": p,
            "q": q,
            "r": r,
        }
        wanted = {name: float(np.rad2deg(value)) for name, value in degrees.items()}
        given = dict(zip(COMMANDS, point[len(STATES) :].tolist(), strict=True))
        set_condition(fdm, craft, {**fixed, **wanted, **given, "tas": v_total * CHANNELS["tas"].scale})
        body = [fdm[f"accelerations/{axis}dot-ft_sec2"] for axis in "uvw"]
        body += [fdm[f"accelerations/{axis}dot-rad_sec2"] for axis in "pqr"]
        # Euler angle kinematics, with this package's own p, q, r
        phi_dot = p + np.tan(theta) * (q * np.sin(phi) + r * np.cos(phi))
        theta_dot = q * np.cos(phi) - r * np.sin(phi)
        return np.array([*body, phi_dot, theta_dot])

    shifts = np.diag(np.concatenate([_STEPS, _COMMAND_STEPS]))
    matrix = np.column_stack(
        [(derivative(trimmed + shift) - derivative(trimmed - shift)) / (2.0 * shift.sum()) for shift in shifts]
    )
    return LinearModel(state_matrix=matrix[:, : len(STATES)], input_matrix=matrix[:, len(STATES) :], trim=at)
