"""Instrumental variables, sections 3.6.2 and 3.6.3: consistent where noise is fed back into the pseudo inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtmbench.checks import names, number, whole
from gtmbench.errors import InputError
from gtmbench.method.estimators.least_squares import solve, summary
from gtmbench.method.problem import Estimate, Problem, columns_of, require_equations
from gtmbench.method.regression.stretches import Stretch
from gtmbench.method.regression.triangle import Triangle, triangle


@dataclass(frozen=True, kw_only=True)
class InstrumentalVariables:
    """Basic and extended instrumental variables, equations (3.55) and (3.63).

    With Z the lagged instruments, solves ``min || P_Z (y - Phi theta) ||``, P_Z the projection onto Z's columns: as
    many instruments as parameters make that ``Z'y = Z'Phi theta``, equation (3.55); more are solved over-determined.
    A constant is its own instrument.
    Equations run over k = r+delay+past..l-d (less where `future` reaches further ahead). The instruments must move with
    the pseudo inputs and not with the noise: samples of the excitation do.

    Attributes
    ----------
    instruments : tuple of str
        Channels of the record. (3.55) takes the lags -d..r of each.
    delay : int
        Shifts these lags to ``-d + delay .. r + delay``. With an unstable plant the lags of (3.55) are nearly useless
        at the noncausal end: delay by exactly the number of unstable poles, or better, give `past`.
    past, future : int
        The number of further lags on either side: over-determined. A `past` of 5 or more needs no knowledge of the
        poles, and on example 3.2 it errs by 15 to 30 % less than the right delay.
    prefilter : pair of sequences of float, optional
        Numerator and denominator of L(q^-1) in (3.63), by falling powers of q; asymptotically stable.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.InstrumentalVariables(instruments=("c",), delay=3)
    InstrumentalVariables(instruments=('c',), delay=3, past=0, future=0, prefilter=None)
    """

    instruments: tuple[str, ...]
    delay: int = 0
    past: int = 0
    future: int = 0
    prefilter: tuple[Sequence[float], Sequence[float]] | None = None

    def __post_init__(self) -> None:
        given = names("instruments", self.instruments)
        if not given:
            raise InputError("instruments are missing; name one channel or more")
        object.__setattr__(self, "instruments", given)
        for name in ("delay", "past", "future"):
            object.__setattr__(self, name, whole(name, getattr(self, name)))
        if self.prefilter is not None:
            _check_prefilter(self.prefilter)

    def estimate(self, problem: Problem) -> Estimate:
        """Return the instrumental-variables estimate."""
        r, d = problem.causal_order, problem.noncausal_order
        causal, noncausal = r + self.delay + self.past, max(d, d - self.delay + self.future)
        kept = range(causal, -(d - self.delay + self.future) - 1, -1)
        own = set(problem.instruments) & set(problem.outputs)
        if own and kept[-1] <= 0:
            raise InputError(
                f"'{min(own)}' is instrument and pseudo output, with lag {kept[-1]}, so it carries the noise that it "
                "should be free of; choose another instrument, or a delay beyond the noise's memory"
            )
        instruments, count = len(problem.instruments), len(problem.instruments) + len(problem.inputs)
        if len(kept) * instruments < problem.parameters:
            raise InputError(
                f"{len(kept)} lags of {instruments} instruments ({', '.join(problem.instruments)}) can't determine "
                f"{problem.parameters} Markov parameters; add instruments, or lags by past and future"
            )
        z = columns_of(range(instruments), kept, count=count, causal_order=causal)
        phi = columns_of(range(instruments, count), range(r, -d - 1, -1), count=count, causal_order=causal)
        what = f"{len(z)} lags of the instruments{' and a constant' if problem.with_constant else ''}"
        require_equations(problem, causal + noncausal + 1, len(z) + problem.with_constant, what)
        stretches = self._prefiltered(problem)
        equations = triangle(
            stretches, count, causal, noncausal, np.concatenate([z, phi]), constant=problem.with_constant
        )
        return _estimate(problem, equations, len(z))

    def _prefiltered(self, problem: Problem) -> tuple[Stretch, ...]:
        if self.prefilter is None:
            return problem.stretches
        import scipy.signal

        count = len(problem.instruments)
        parts = []
        for part in problem.stretches:
            values = part.read(0, len(part)).copy()
            values[:count] = scipy.signal.lfilter(*self.prefilter, values[:count], axis=1)
            parts.append(part.replace(values))
        return tuple(parts)


def _check_prefilter(prefilter: tuple[Sequence[float], Sequence[float]]) -> None:
    try:
        numerator, denominator = (list(part) for part in prefilter)
    except (TypeError, ValueError):
        raise InputError(
            f"prefilter is {prefilter!r}; give two sequences, the coefficients of numerator and denominator"
        ) from None
    for value in (*numerator, *denominator):
        number("prefilter's coefficient", value)
    if not any(numerator) or not denominator or denominator[0] == 0:
        raise InputError("prefilter needs a numerator that isn't 0 and a denominator whose first coefficient isn't 0")
    greatest = float(np.abs(np.roots(denominator)).max(initial=0.0))
    if greatest >= 1.0:
        raise InputError(
            f"prefilter has a pole of magnitude {greatest:.4g}; instruments need an asymptotically stable filter, with "
            "all poles inside the unit circle"
        )


def _estimate(problem: Problem, equations: Triangle, instruments: int) -> Estimate:
    """Solve on what the instruments see of the equations: the rows of R that belong to them."""
    projected = equations.seen_by(instruments)
    theta, rank = solve(projected)
    own = replace(
        equations, root=equations.root[:, instruments:], means=projected.means
    )  # all rows: what is left of y counts them
    return replace(summary(problem, own, theta, rank), root=projected.regressor[np.newaxis])
