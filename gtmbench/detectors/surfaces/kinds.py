"""Which kind of fault a surface has, as far as its answer tells: stuck, weak, slow or off.

Over sixteen seconds behind an alarm, b is the share of the command that is missing and c how late it comes. A surface
that is stuck answers nothing, b = -1, wherever it is; one that has lost effectiveness answers less, at once; one that
is slow answers later; a bent one answers as it did, with another zero. Where the command hardly moved, none of it
shows.
"""

from __future__ import annotations

import numpy as np

from gtmbench.detectors.surfaces.deviation import LABELS
from gtmbench.values.record import FloatArray

KIND_TESTS = (LABELS.index("offset 16 s"), LABELS.index("answer 16 s"))
_SURE = 4.0  # deviations
_KNOWN = 0.15  # of b, whose deviation has to be less: more tells neither that it changed nor that it didn't
_SMALL = 0.25  # of the command: a loss below passes for none, and one above 1 less that for all


def kind_of(ratios: FloatArray, fit: FloatArray, spread: FloatArray, error: float = 0.0) -> str | None:
    """Return ``jam``, ``scale_factor``, ``lag``, ``bias``, or None where several would do.

    `ratios`, shape (2,): the tests of the offset and of the answer over their thresholds. `fit`, `spread`: by how much
    b and c have changed, and their covariance. `error`: by how much b would have had to change to be seen by one
    deviation: large where the command stood still.

    >>> sure = np.diag([0.05, 0.02]) ** 2
    >>> changes = {"stuck": (-0.98, 0.01), "weak": (-0.5, 0.0), "slow": (0.1, -0.2), "off": (0.02, 0.0)}
    >>> {what: kind_of(np.array([3.0, 9.0 * (what != "off")]), np.array(fit), sure) for what, fit in changes.items()}
    {'stuck': 'jam', 'weak': 'scale_factor', 'slow': 'lag', 'off': 'bias'}
    >>> kind_of(np.array([3.0, 2.0]), np.array([-0.7, 0.1]), 20.0 * sure) is None  # weak or stuck
    True
    """
    if not (np.isfinite(spread).all() and np.isfinite(fit).all()):
        return None
    loss, late = fit
    of_loss, of_late = np.sqrt(np.maximum(np.diag(spread), 0.0))
    offset, answer = np.nan_to_num(ratios)
    if max(of_loss, error) > _KNOWN:
        return None
    if answer <= 1.0:
        return "bias" if offset > 1.0 and abs(loss) < _SMALL else None
    if abs(loss + 1.0) < _SMALL and loss < -_SURE * of_loss:
        return "jam"
    if late < -_SURE * of_late and loss > -_SMALL:
        return "lag"
    if -1.0 + _SMALL < loss < -_SMALL and abs(late) < _SURE * of_late:
        return "scale_factor"
    return None
