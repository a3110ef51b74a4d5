"""Spread: what statistics are told of an uncertain operator, beside its residual."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread:
    """How far a residual may be off where its operator is uncertain.

    Attributes
    ----------
    raw, white : shape (samples,)
        By which the residual, as it is and whitened, is divided before its energy is judged; 1 where all is known.
    means : mapping of int to array of shape (samples,)
        Of windows of so many samples: the variance of their mean about that of the baseline before, in whitened
        samples, from the operator's error alone. That is one error, at all samples: windows don't average it out.
    """

    raw: FloatArray = field(repr=False)
    white: FloatArray = field(repr=False)
    means: Mapping[int, FloatArray] = field(default_factory=dict, repr=False)

    def between(self, rows: slice) -> Spread:
        """Return some rows."""
        means = {window: values[rows] for window, values in self.means.items()}
        return Spread(raw=self.raw[rows], white=self.white[rows], means=means)

    @staticmethod
    def joined(parts: Sequence[Spread]) -> Spread:
        """Return parts that follow each other as one; at least one, of the same windows."""
        return Spread(
            raw=np.concatenate([part.raw for part in parts]),
            white=np.concatenate([part.white for part in parts]),
            means={window: np.concatenate([part.means[window] for part in parts]) for window in parts[0].means},
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Given:
    """What a statistic is made of: a residual over its spread, and as it is; `means` as in `Spread`.

    `uncertain` is the share of the variance of `values` that an operator's error has, 0 where all is known.
    """

    values: FloatArray
    plain: FloatArray
    means: Mapping[int, FloatArray]
    uncertain: FloatArray
