"""A linear quadratic regulator about the trim, designed on the linear model before every flight.

gtmbench fly --closed-loop --controller lqr.py:Lqr --excitation turbulence --noise t2 --out lqr.csv
"""

import numpy as np
from scipy.linalg import solve_continuous_are

import gtmbench as gb

LARGEST = [10, 10, 10, 0.3, 0.3, 0.3, 0.2, 0.1, 20, 0.1]  # ft/s, rad/s, rad, ft, rad: what one lets happen
MOST = [5, 5, 5, 30]  # deg, percent: what one moves for that


class Lqr:
    def start(self, trim):
        model = gb.linearised("gtm")  # x' = A x + B u, x = u, v, w, p, q, r, phi, theta
        self.trim, self.speed = trim, model.speed_ft_s
        A, B = np.zeros((10, 10)), np.zeros((10, 4))
        A[:8, :8], B[:8] = model.state_matrix, model.input_matrix
        A[8, 2], A[8, 7], A[9, 5] = -1.0, self.speed, 1.0  # the altitude climbs by V theta - w, the heading turns by r
        Q, R = np.diag(1.0 / np.square(LARGEST)), np.diag(1.0 / np.square(MOST))
        self.gain = np.linalg.solve(R, B.T @ solve_continuous_are(A, B, Q, R))

    def command(self, now, time_s):
        at = self.trim
        deg = [now.beta, now.alpha - at.alpha_deg, now.p, now.q, now.r, now.phi - at.roll_deg, now.theta - at.pitch_deg]
        v, w, *rest = np.deg2rad(deg)
        state = [(now.tas - at.tas_kt) * 1.688, self.speed * v, self.speed * w, *rest]
        state += [now.altitude - at.altitude_ft, np.deg2rad(now.psi - at.yaw_deg)]
        return list(at.commands.values()) - self.gain @ state
