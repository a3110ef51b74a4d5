"""The least-squares problem that every solver gets. No import of gtmbench: it is handed to other environments."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np


@dataclass(frozen=True, eq=False)
class Problem:
    """Pseudo inputs (samples, inputs) and one pseudo output (samples,), their means removed, and the orders r, d."""

    inputs: np.ndarray
    output: np.ndarray
    causal_order: int
    noncausal_order: int

    @property
    def lags(self) -> int:
        """How many: r + d + 1."""
        return self.causal_order + self.noncausal_order + 1

    def regressor(self, *, constant: bool = False) -> np.ndarray:
        """Return one row an equation, newest sample (lag -d) first; if asked, a column of ones comes last."""
        windows = np.lib.stride_tricks.sliding_window_view(self.inputs, self.lags, axis=0)[:, :, ::-1]
        rows = windows.transpose(0, 2, 1).reshape(len(windows), -1)
        return np.column_stack([rows, np.ones(len(rows))]) if constant else rows

    def target(self) -> np.ndarray:
        """Return the output of every equation."""
        return self.output[self.causal_order : len(self.output) - self.noncausal_order]

    def markov(self, theta: np.ndarray) -> np.ndarray:
        """Return the parameters of a regressor's columns as (lags, inputs), without the constant's."""
        return theta.ravel()[: self.lags * self.inputs.shape[1]].reshape(self.lags, -1)

    def delayed(self) -> np.ndarray:
        """Return the output d + 1 samples late: on it, the model is causal with lags 1..r + d + 1."""
        early = self.output[: len(self.output) - self.noncausal_order]
        return np.concatenate([np.zeros(self.noncausal_order + 1), early])

    def start(self, samples: int) -> Problem:
        """Return the problem of the first samples: something small to warm up on."""
        return replace(self, inputs=self.inputs[:samples], output=self.output[:samples])

    def save(self, path: Path) -> None:
        """Write it as .npz."""
        np.savez(path, inputs=self.inputs, output=self.output, orders=[self.causal_order, self.noncausal_order])

    @classmethod
    def load(cls, path: Path) -> Problem:
        """Read what `save` wrote."""
        with np.load(path) as saved:
            return cls(saved["inputs"], saved["output"], *saved["orders"].tolist())
