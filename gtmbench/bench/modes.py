"""The linear modes about trim: natural frequency and damping of short period, phugoid, dutch roll, roll and spiral."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from scipy.linalg import eig

from gtmbench.bench.aircraft import load_aircraft, quiet
from gtmbench.bench.trim import set_condition, trimmed_engine
from gtmbench.record import FloatArray

STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta")  # ft/s, rad/s, rad
_STEPS = np.array([0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-3, 1e-4, 1e-4])
_LATERAL = np.array([False, True, False, True, False, True, True, False])


@dataclass(frozen=True, kw_only=True)
class Mode:
    """One mode: an eigenvalue (the upper one of a pair) with its natural frequency and damping ratio.

    ``time_constant_s`` is -1/Re of the eigenvalue: negative where the mode grows.
    """

    name: str
    real_1_s: float
    imag_1_s: float
    natural_frequency_rad_s: float
    damping: float
    time_constant_s: float


def modes(aircraft: str = "gtm") -> list[Mode]:
    """Return the modes of an aircraft about its trim, fastest first.

    The eigenvalues of the state matrix of u, v, w, p, q, r, phi and theta, by central differences of the nonlinear
    model; surfaces, engines and altitude stand still.

    Raises
    ------
    TrimError
        Where the aircraft can't be trimmed.
    """
    values, vectors = eig(state_matrix(aircraft))
    found = [(value, _lateral_share(vectors[:, i])) for i, value in enumerate(values) if value.imag >= 0]
    found.sort(key=lambda pair: -abs(pair[0]))
    named: list[Mode] = []
    for value, lateral in found:
        kind = ("lateral" if lateral > 0.5 else "longitudinal", value.imag > 0)
        same = [other for other, share in found if (share > 0.5, other.imag > 0) == (lateral > 0.5, value.imag > 0)]
        names = {
            ("longitudinal", True): ["short period", "phugoid"],
            ("lateral", True): ["dutch roll", "lateral phugoid"],
            ("lateral", False): ["roll", "spiral"],
            ("longitudinal", False): ["pitch", "speed"],
        }[kind]
        rank = same.index(value)
        name = names[rank] if rank < len(names) else f"{kind[0]} {rank + 1}"
        named.append(
            Mode(
                name=name,
                real_1_s=float(value.real),
                imag_1_s=float(value.imag),
                natural_frequency_rad_s=float(abs(value)),
                damping=float(-value.real / abs(value)) if value else 0.0,
                time_constant_s=float(-1.0 / value.real) if value.real else float("inf"),
            )
        )
    return named


def _lateral_share(vector: FloatArray) -> float:
    """Return how much of a mode lies in v, p, r and phi; velocities count as angles (ft/s over the airspeed)."""
    weight = np.abs(vector) / np.array([170.0, 170.0, 170.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    return float(np.sum(weight[_LATERAL] ** 2) / np.sum(weight**2))


def state_matrix(aircraft: str = "gtm") -> FloatArray:
    """Return d(x')/dx at trim, shape (8, 8), in the order of `STATES`; ft/s, rad/s and rad."""
    craft = load_aircraft(aircraft)
    fdm, at = trimmed_engine(craft, 0.01)
    speed = at.tas_kt * 1852.0 / 3600.0 / 0.3048
    alpha, phi, theta = np.deg2rad([at.alpha_deg, at.roll_deg, at.pitch_deg])
    trimmed = np.array([speed * np.cos(alpha), 0.0, speed * np.sin(alpha), 0.0, 0.0, 0.0, phi, theta])
    fixed = {**at.commands, "altitude": at.altitude_ft, "psi": at.yaw_deg}

    def derivative(x: FloatArray) -> FloatArray:
        u, v, w, p, q, r, phi, theta = x
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
        set_condition(fdm, craft, {**fixed, **wanted, "tas": v_total * 3600.0 * 0.3048 / 1852.0})
        body = [fdm[f"accelerations/{axis}dot-ft_sec2"] for axis in "uvw"]
        body += [fdm[f"accelerations/{axis}dot-rad_sec2"] for axis in "pqr"]
        # Euler angle kinematics, with this package's own p, q, r
        phi_dot = p + np.tan(theta) * (q * np.sin(phi) + r * np.cos(phi))
        theta_dot = q * np.cos(phi) - r * np.sin(phi)
        return np.array([*body, phi_dot, theta_dot])

    columns = []
    with quiet():
        for i, step in enumerate(_STEPS):
            shift = np.zeros(len(STATES))
            shift[i] = step
            columns.append((derivative(trimmed + shift) - derivative(trimmed - shift)) / (2.0 * step))
    return np.column_stack(columns)


def mode_rows(found: list[Mode]) -> list[dict[str, float | str]]:
    """Return the modes as plain dictionaries, for tables and JSON."""
    return [asdict(mode) for mode in found]
