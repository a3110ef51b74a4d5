"""What a user would reach for: every solver takes a `Problem` and returns a call that gives (lags, inputs).

Where an interface takes a regressor, it is ready-made: only the solving is timed. Where it takes samples, the output
comes late, so that the noncausal model is a causal one, with one sample of padding: all solve the same equations.
No import of gtmbench, and each solver's package is imported by itself only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .problem import Problem

Solve = Callable[[], np.ndarray]


@dataclass(frozen=True)
class Solver:
    """How to prepare it, its package, what to know of it; pins that conflict with ours ask for an own environment."""

    prepare: Callable[[Problem], Solve]
    package: str
    note: str
    constant: bool = False  # whether it can't leave out a constant: then it is held against lstsq with one
    environment: tuple[str, ...] = ()


def numpy_lstsq(problem: Problem) -> Solve:
    regressor, target = problem.regressor(), problem.target()
    return lambda: problem.markov(np.linalg.lstsq(regressor, target, rcond=None)[0])


def scipy_gelsy(problem: Problem) -> Solve:
    from scipy.linalg import lstsq

    regressor, target = problem.regressor(), problem.target()
    return lambda: problem.markov(lstsq(regressor, target, lapack_driver="gelsy")[0])


def statsmodels_ols(problem: Problem) -> Solve:
    from statsmodels.api import OLS

    regressor, target = problem.regressor(), problem.target()
    return lambda: problem.markov(OLS(target, regressor).fit().params)


def sklearn_linear_regression(problem: Problem) -> Solve:
    from sklearn.linear_model import LinearRegression

    regressor, target = problem.regressor(), problem.target()
    return lambda: problem.markov(LinearRegression(fit_intercept=False).fit(regressor, target).coef_)


def control_markov(problem: Problem) -> Solve:
    from control import markov

    late, u = problem.delayed(), np.pad(problem.inputs, ((1, 0), (0, 0))).T  # its lags start at 0
    return lambda: markov(late, u, problem.lags, truncate=True)[0].T


def sippy_fir(problem: Problem) -> Solve:
    from sippy_unipi import system_identification

    late, u = problem.delayed(), np.pad(problem.inputs, ((0, 1), (0, 0))).T
    return lambda: np.array(system_identification(late, u, "FIR", FIR_orders=[problem.lags, 0]).NUMERATOR[0]).T


def sysidentpy_frols(problem: Problem) -> Solve:
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    late, u = problem.delayed()[:, np.newaxis], np.pad(problem.inputs, ((0, 1), (0, 0)))
    terms = problem.lags * u.shape[1] + 1

    def solve() -> np.ndarray:
        model = FROLS(
            order_selection=False,
            n_terms=terms,
            xlag=[list(range(1, problem.lags + 1))] * u.shape[1],
            ylag=1,
            model_type="NFIR",
            basis_function=Polynomial(degree=1),
            estimator=LeastSquares(),
        ).fit(X=u, y=late)
        theta = np.zeros(terms)
        theta[model.pivv] = model.theta.ravel()  # column 0 is the constant, then the lags, one input after the other
        return theta[1:].reshape(u.shape[1], problem.lags).T

    return solve


LSTSQ = "numpy lstsq"
SOLVERS = {
    LSTSQ: Solver(numpy_lstsq, "numpy", "singular values (gelsd)"),
    "scipy gelsy": Solver(scipy_gelsy, "scipy", "QR with column pivoting"),
    "statsmodels OLS": Solver(statsmodels_ols, "statsmodels", "pseudo-inverse, and the covariance"),
    "scikit-learn LinearRegression": Solver(sklearn_linear_regression, "scikit-learn", "scipy's gelsd"),
    "control.markov": Solver(control_markov, "control", "builds its regressor; numpy's lstsq"),
    "sippy_unipi FIR": Solver(sippy_fir, "sippy_unipi", "builds its regressor; numpy's pinv"),
    "sysidentpy FROLS": Solver(
        sysidentpy_frols,
        "sysidentpy",
        "selects all terms one by one; always with a constant, so compared with lstsq with one",
        constant=True,
        environment=("sysidentpy==0.9.0", "numpy==2.3.5", "scipy==1.17.1"),
    ),
}
