"""Isolation forest on windows: what random cuts set apart from the rest quickly is odd.

Source: F. T. Liu, K. M. Ting and Z.-H. Zhou, Isolation forest, ICDM 2008, doi:10.1109/ICDM.2008.17: its anomaly score,
2^(-E(h(x)) / c(n)). scikit-learn grows the trees; they are kept as tables. It can't tell which gyro.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gtmbench.detectors.rivals.rival import Model, Rival
from gtmbench.detectors.rivals.signals import CHANNELS, Generator, Lookback, Scale, features_of, stacked
from gtmbench.imports import load_extra
from gtmbench.values.record import FloatArray

_THINNED_S = 0.1  # a window is learnt from every so often
_EULER = 0.5772156649  # Euler's constant, by definition


@dataclass(frozen=True, kw_only=True)
class IsolationForest(Rival):
    """The forest's anomaly score of the window up to each sample.

    Parameters
    ----------
    window_s : float
    trees : int
    """

    name: str = "isolation-forest"
    title: ClassVar[str] = "isolation forest on windows of all sensors"
    judge: str = "level"
    window_s: float = 0.5
    trees: int = 100
    channels: ClassVar[tuple[str, ...]] = CHANNELS
    outputs: ClassVar[tuple[str, ...]] = ("forest",)

    def fit(self, records: Sequence[FloatArray], sample_period_s: float) -> Model:
        """Return the trees, shape (trees, nodes): children, feature, cut and depth (a leaf's: until x is alone)."""
        ensemble = load_extra("sklearn.ensemble", "rivals", f"'{self.name}' needs")
        step = max(round(_THINNED_S / sample_period_s), 1)
        rows = self._rows(sample_period_s)
        x = stacked(features_of(values, rows, sample_period_s)[::step] for values in records)
        scale = Scale.of(x)
        forest = ensemble.IsolationForest(n_estimators=self.trees, random_state=0).fit(scale.standard(x))
        trees = [found.tree_ for found in forest.estimators_]
        size = max(tree.node_count for tree in trees)
        kept = {name: np.zeros((len(trees), size)) for name in ("left", "right", "feature", "cut", "depth")}
        for i, tree in enumerate(trees):
            nodes, is_leaf = np.arange(tree.node_count), tree.children_left < 0
            kept["left"][i, nodes] = np.where(is_leaf, nodes, tree.children_left)  # who has arrived stays
            kept["right"][i, nodes] = np.where(is_leaf, nodes, tree.children_right)
            kept["feature"][i, nodes] = np.where(is_leaf, 0, tree.feature)
            kept["cut"][i, nodes] = np.where(is_leaf, 0.0, tree.threshold)
            kept["depth"][i, nodes] = _depths(tree.children_left, tree.children_right) + _path(tree.n_node_samples)
        least = float(_path(np.array([forest.max_samples_]))[0])
        return {"mean": scale.mean, "deviation": scale.deviation, "path": np.array([least]), **kept}

    def generator(self, model: Model, sample_period_s: float) -> Generator:
        """Return what scores windows."""
        scale = Scale(mean=model["mean"], deviation=model["deviation"])
        left, right, feature = (model[name].astype(int) for name in ("left", "right", "feature"))
        cut, depth, rows = model["cut"], model["depth"], self._rows(sample_period_s)

        def work(values: FloatArray) -> FloatArray:
            x = scale.standard(features_of(values, rows, sample_period_s)[rows + 1 :]).astype(
                np.float32
            )  # as trees grew
            total = np.zeros(len(x))
            each = np.arange(len(x))
            for i in range(len(left)):
                node = np.zeros(len(x), dtype=int)
                for _ in range(left.shape[1]):
                    after = np.where(x[each, feature[i][node]] <= cut[i][node], left[i][node], right[i][node])
                    if np.array_equal(after, node):
                        break
                    node = after
                total += depth[i][node]
            scores = np.exp2(-total / len(left) / model["path"])
            scores[np.isnan(x).any(axis=1)] = np.nan
            return scores[:, np.newaxis]

        return Lookback(rows + 1, len(CHANNELS), work)

    def _rows(self, sample_period_s: float) -> int:
        return max(round(self.window_s / sample_period_s), 2)


def _depths(left: np.ndarray, right: np.ndarray) -> FloatArray:
    """Return how many cuts lead to each node; children stand after their parents."""
    depths = np.zeros(len(left))
    for node in np.flatnonzero(left >= 0):
        depths[[left[node], right[node]]] = depths[node] + 1.0
    return depths


def _path(samples: np.ndarray) -> FloatArray:
    """Return c(n): how many further cuts isolate one of n samples, on average."""
    n = np.maximum(np.asarray(samples, dtype=float), 2.0)
    further = 2.0 * (np.log(n - 1.0) + _EULER) - 2.0 * (n - 1.0) / n
    return np.where(samples > 2, further, np.where(samples == 2, 1.0, 0.0))
