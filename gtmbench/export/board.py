"""What of a calibrated bank goes on board: its numbers as flat tables, or a line that says why it can't."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.monitor.regime import Regime
from gtmbench.detectors.statistics.learnt_noise import lasting_rows, second_order, suspicion_rows
from gtmbench.detectors.statistics.statistic import least_baseline, ordinary_powers
from gtmbench.errors import InputError
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS
from gtmbench.values.channels import CHANNELS
from gtmbench.values.record import FloatArray

EXPORTABLE = "a bank of gyros and attitude that `gtmbench calibrate` makes of flights (bank C, C-early) can"
DERIVED = {  # pseudo inputs as C, of slopes (S), sines and cosines of angles; in deg/s
    "p_att": "S(phi) - S(psi) * sinf(A(theta))",
    "q_att": "S(theta) * cosf(A(phi)) + S(psi) * cosf(A(theta)) * sinf(A(phi))",
    "r_att": "S(psi) * cosf(A(theta)) * cosf(A(phi)) - S(theta) * sinf(A(phi))",
    "q_turn": "(S(theta) + V(r) * sinf(A(phi))) / cosf(A(phi))",
    "p_turn": "S(phi) - tanf(A(theta)) * ((S(theta) + V(r) * sinf(A(phi))) / cosf(A(phi)) * sinf(A(phi)) "
    "+ V(r) * cosf(A(phi)))",
    **{f"{angle}_rate": f"S({angle})" for angle in ("phi", "theta", "psi", "alpha", "beta")},
}
# what the C code has room for
_MOST = {"residuals": 8, "channels": 16, "inputs": 8, "lags": 256, "whitening": 512, "windows": 16, "rows": 60_000}
_PERIODS_S = (0.001, 0.5)  # of what the C code counts in samples
_FLOAT = 1e30  # what a float holds with room for its square root's like


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardResidual:
    """One residual as the C code has it."""

    output: str
    inputs: tuple[str, ...]
    markov: FloatArray = field(repr=False)  # shape (inputs, lags); for the oldest sample first
    offset: float  # of the prediction, in the output's unit
    whitener: FloatArray = field(repr=False)  # shape (n + 1,); for the oldest residual first, over the deviation
    ahead: int  # rows after its own that a residual is known
    is_late: bool  # whether its inputs are those of the sample before the last, as derivatives are
    suspects: tuple[str, ...]  # sensors whose fault enters it
    # mean_thresholds, energy_thresholds: shape (windows,)
    mean_thresholds: FloatArray = field(repr=False)
    energy_thresholds: FloatArray = field(repr=False)
    tolerance: tuple[float, float, float]  # of the mean; low and high of the energy


@dataclass(frozen=True, kw_only=True, eq=False)
class Board:
    """A calibrated bank as the C code has it; sizes are in samples."""

    name: str
    channels: tuple[str, ...]  # whose places are the bits of masks of sensors
    derived: tuple[str, ...]  # pseudo inputs
    residuals: tuple[BoardResidual, ...]  # in the order of their names, as the bits of masks of residuals
    windows: tuple[int, ...]
    baseline: int
    least_baseline: int
    suspicions: tuple[int, ...]  # windows of the noise that is learnt
    # block, order, lasting, echo, apart: of the noise that is learnt
    block: int
    order: int
    lasting: int
    echo: int
    apart: int
    lost: int  # over so many rows missing samples are counted
    period_s: float

    @property
    def signals(self) -> tuple[str, ...]:
        """Channels, then pseudo inputs."""
        return self.channels + self.derived

    def near(self, residual: BoardResidual) -> FloatArray:
        """Return how far a window's mean may be from the baseline's before its ratio can pass its threshold."""
        chance = 1.0 / np.array(self.windows) + 1.0 / self.baseline
        return np.asarray(residual.tolerance[0] + np.sqrt(2.0 * residual.mean_thresholds * chance))

    def ordinary(self, residual: BoardResidual) -> FloatArray:
        """Return between which powers no ratio can pass its threshold, shape (windows, 2)."""
        powers = [
            ordinary_powers(rows, nats)
            for rows, nats in zip(self.windows, residual.energy_thresholds.tolist(), strict=True)
        ]
        return np.asarray(np.array(powers) * np.array(residual.tolerance[1:]))


def board_of(monitor: object) -> Board:
    """Return what goes on board of a monitor."""
    if not isinstance(monitor, CalibratedBank):
        name = str(getattr(monitor, "name", type(monitor).__name__))
        raise InputError(f"a monitor of '{name}' can't be exported: only banks can; {EXPORTABLE}")
    _check_kind(monitor)
    period_s, test = monitor.sample_period_s, monitor.bank.statistic
    windows = test.rows(period_s)
    residuals = tuple(_residual(monitor, output, windows) for output in sorted(monitor.operators))
    names = {name for residual in residuals for name in (residual.output, *residual.inputs)}
    board = Board(
        name=monitor.bank.name,
        channels=monitor.bank.channels,
        derived=tuple(sorted(name for name in names if name in PSEUDO_INPUTS)),
        residuals=residuals,
        windows=tuple(windows),
        baseline=max(round(test.baseline_s / period_s), 6),
        least_baseline=least_baseline(max(round(test.baseline_s / period_s), 6)),
        suspicions=tuple(suspicion_rows(period_s)),
        block=max(round(0.5 / period_s), 5),
        order=second_order(period_s),
        lasting=lasting_rows(period_s),
        echo=max(round(0.25 / period_s), 1),
        apart=max(round(1.0 / period_s), 1),
        lost=4 * max(round(0.5 / period_s), 5),
        period_s=period_s,
    )
    _check_sizes(board)
    return board


def _check_kind(monitor: CalibratedBank) -> None:
    """Refuse what the C code has no part for."""
    bank = monitor.bank
    if bank.statistic.name != "glr":
        raise InputError(
            f"bank {bank.name} judges by '{bank.statistic.name}', and on board there is 'glr' only; {EXPORTABLE}"
        )
    if monitor.is_cautious:
        raise InputError(
            f"bank {bank.name} was identified on little flight, so its residuals are judged by how uncertain its "
            f"operators are, which has no place on board; calibrate it on more flights: {EXPORTABLE}"
        )
    if Regime.from_provenance(monitor.provenance).limits:
        raise InputError(
            f"bank {bank.name} was calibrated on logs and says nothing in motion harder than theirs, which the C code "
            f"wouldn't notice; {EXPORTABLE}"
        )
    low, high = _PERIODS_S
    if not low <= monitor.sample_period_s <= high:
        raise InputError(f"a sample every {monitor.sample_period_s:g} s; on board it is {low:g} to {high:g} s")
    unknown = [name for name in bank.channels if name not in CHANNELS]
    if unknown:
        raise InputError(f"channel '{unknown[0][:40]}' has no known unit; on board are {', '.join(CHANNELS)}")
    for spec in bank.residuals:
        for name in (spec.output, *spec.inputs):
            if name in PSEUDO_INPUTS and name not in DERIVED:
                raise InputError(
                    f"the residual of {spec.output} needs '{name}', of which there is no C code; there is of "
                    f"{', '.join(DERIVED)}"
                )


def _residual(monitor: CalibratedBank, output: str, windows: Sequence[int]) -> BoardResidual:
    operator, whitener, tolerance = monitor.operators[output], monitor.whiteners[output], monitor.tolerances[output]
    period_s, bank = monitor.sample_period_s, monitor.bank
    ahead = round(monitor.look_ahead_of(output) / period_s)
    markov = operator.markov[::-1, 0, :].T
    source = next(spec.source for spec in bank.residuals if spec.output == output)
    return BoardResidual(
        output=output,
        inputs=operator.inputs,
        markov=markov,
        offset=float(operator.output_means[0] - markov.sum(axis=1) @ operator.input_means),
        whitener=whitener.coefficients[::-1] / whitener.deviation,
        ahead=ahead,
        is_late=ahead > operator.noncausal_order,
        suspects=tuple(name for name in bank.suspects if source in bank.affects(name)),
        mean_thresholds=_thresholds(monitor.thresholds[output], "mean", windows, period_s),
        energy_thresholds=_thresholds(monitor.thresholds[output], "energy", windows, period_s),
        tolerance=(tolerance.mean, tolerance.low if bank.statistic.two_sided else 0.0, tolerance.high),
    )


def _thresholds(own: Mapping[str, float], kind: str, windows: Sequence[int], period_s: float) -> FloatArray:
    return np.array([own[f"{kind} {rows * period_s:g} s"] for rows in windows])


def _check_sizes(board: Board) -> None:
    """Refuse sizes that no flight controller has room for, and numbers that a float can't hold."""
    sizes = {
        "residuals": len(board.residuals),
        "channels": len(board.channels),
        "windows": len(board.windows),
        "rows": max(board.baseline, board.windows[-1]),
        "inputs": max(len(each.inputs) for each in board.residuals),
        "lags": max(each.markov.shape[1] for each in board.residuals),
        "whitening": max(len(each.whitener) for each in board.residuals),
    }
    words = {"rows": "samples of a window or baseline", "inputs": "inputs of a residual", "lags": "lags of an operator"}
    for key, size in sizes.items():
        if size > _MOST[key]:
            raise InputError(f"{size} {words.get(key, key)}; on board there are at most {_MOST[key]}; {EXPORTABLE}")
    for each in board.residuals:
        if each.ahead >= _MOST["lags"]:
            raise InputError(f"the residual of {each.output} looks {each.ahead} samples ahead; on board at most 255")
        thresholds = np.concatenate([each.mean_thresholds, each.energy_thresholds])
        numbers = np.concatenate([each.markov.ravel(), each.whitener, [each.offset, *each.tolerance]])
        if not (np.abs(numbers) < _FLOAT).all() or not (thresholds > 1.0 / _FLOAT).all():
            raise InputError(f"the residual of {each.output} has a number that a float can't hold; calibrate anew")
        if not (thresholds[thresholds < math.inf] < _FLOAT).all():
            raise InputError(f"the residual of {each.output} has a threshold that a float can't hold; calibrate anew")
