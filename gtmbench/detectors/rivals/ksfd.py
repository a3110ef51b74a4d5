"""Kinematics-based sensor fault detection, KSFD: what sensors say of one motion, differentiated; nothing is learnt.

Source: S. Verma and D. S. Bernstein, Real-time kinematics-based sensor-fault detection for autonomous vehicles using
single and double transport with adaptive numerical differentiation, arXiv:2309.05158. Of its nine error metrics those
are here that the T2's sensors allow: gyros against the attitude's derivatives, and accelerometers against those of the
velocity through the air (single transport; the source has radar and magnetometers). Differentiation is a local
polynomial's at its newest sample (A. Savitzky and M. J. E. Golay, Analytical Chemistry 36 (1964),
doi:10.1021/ac60214a047), not the source's adaptive input and state estimation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gtmbench.detectors.rivals.rival import Model, Rival
from gtmbench.detectors.rivals.signals import AIR, Generator, Lookback, body_rates, running
from gtmbench.method.filters import filtered
from gtmbench.values.channels import ATTITUDE, G_M_S2, GYROS
from gtmbench.values.record import FloatArray

# by definition
_M_S_PER_KT = 1852.0 / 3600.0


@dataclass(frozen=True, kw_only=True)
class KinematicConsistency(Rival):
    """Error metrics e: p, q and r less those of the attitude's derivatives; nx, ny and nz less V' + omega x V - g.

    Judged as levels of e^2, which learns nothing, or whitened as everybody else's residuals (``judge = "glr"``).

    Parameters
    ----------
    span_s, degree : float, int
        Of the local polynomial.
    forces : bool
        Whether accelerometers are asked, too. Whitened, their metrics alarm at steps of the surfaces.
    """

    name: str = "ksfd"
    judge: str = "level"
    span_s: float = 0.2
    degree: int = 2
    forces: bool = True
    channels: ClassVar[tuple[str, ...]] = (*GYROS, *ATTITUDE, *AIR)

    @property
    def title(self) -> str:
        """What it is, in a line."""
        how = "nothing learnt" if self.judge == "level" else "whitened and judged as the banks'"
        return f"kinematic consistency by differentiation (KSFD), {how}"

    @property
    def outputs(self) -> tuple[str, ...]:
        """The metrics: the gyros', and those of the accelerometers, which several gyros enter."""
        return (*GYROS, *(("nx", "ny", "nz") if self.forces else ()))

    def generator(self, model: Model, sample_period_s: float) -> Generator:
        """Return what makes the error metrics."""
        from scipy.signal import savgol_coeffs

        rows = max(round(self.span_s / sample_period_s), self.degree + 1)
        taps = savgol_coeffs(rows, self.degree, deriv=1, delta=sample_period_s, pos=rows - 1)
        markov = taps[:, np.newaxis, np.newaxis] * np.eye(6)  # the newest first

        def work(values: FloatArray) -> FloatArray:
            angles, (alpha, beta) = values[:, 3:6], np.deg2rad(values[:, 6:8].T)
            speed = values[:, 11] * _M_S_PER_KT
            velocity = speed * np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
            known = [angles[:, 0], angles[:, 1], running(angles[:, 2]), *velocity]
            slopes = np.full((len(values), 6), np.nan)
            slopes[rows - 1 :] = filtered(known, markov, np.zeros(6))
            errors = values[:, :3] - body_rates(angles, slopes[:, :3])
            if self.forces:
                errors = np.hstack([errors, _forces(values, velocity, slopes[:, 3:])])
            return errors if self.judge == "glr" else np.square(errors)

        return Lookback(rows, len(self.channels), work)


def _forces(values: FloatArray, velocity: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return specific forces less those of the motion, in m/s2, shape (rows, 3); nz is upwards."""
    (p, q, r), (phi, theta) = np.deg2rad(values[:, :3].T), np.deg2rad(values[:, 3:5].T)
    (u, v, w), (nx, ny, nz) = velocity, values[:, 8:11].T
    du, dv, dw = slopes.T
    return np.column_stack(
        [
            G_M_S2 * nx - (du + q * w - r * v + G_M_S2 * np.sin(theta)),
            G_M_S2 * ny - (dv + r * u - p * w - G_M_S2 * np.cos(theta) * np.sin(phi)),
            G_M_S2 * nz + (dw + p * v - q * u - G_M_S2 * np.cos(theta) * np.cos(phi)),
        ]
    )
