"""Rivals that enter gtmbench-2 as anybody's do: flights' files in, score files out, no line of gtmbench.

    gtmbench benchmark --quick --export flights
    python experiments/benchmark_entries.py flights entries [NAME ...]
    gtmbench benchmark --quick --score entries/parity-space --score entries/imm ...

The PyOD ones need `pip install pyod` (any environment with pandas and pyarrow). Settings are those of PyOD, and of
the model-based ones the simplest that their sources' theory has. All learn on the flights of `learn` alone. Columns:
p, q, r (deg/s) and phi, theta, psi (deg), lost samples repeated.

- ``parity-space``: temporal redundancy over windows (Chow and Willsky 1984, IEEE Transactions on Automatic Control 29):
  what an angle did less what the gyros say that it did, over 0.2, 1 and 5 s.
- ``unknown-input-observers``: a bank of observers, each blind to one gyro (Chen, Patton and Zhang 1996, International
  Journal of Control 63). All angles are measured, so what an observer is blind to is a projection.
- ``imm``: an interacting-multiple-model filter an axis (Blom and Bar-Shalom 1988, IEEE Transactions on Automatic
  Control 33; as a detector Zhang and Li 1998): the gyro is healthy, or has an error that wanders.
- ``pyod-knn``, ``pyod-iforest``: Ramaswamy and others 2000, Liu and others 2008, by PyOD, on means and deviations of
  gyros, bank and pitch over half a second. PyOD's ECOD (``pyod-ecod``, only by its name) is refused: it ranks a sample
  among all that it is given, those that come later too.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import lfilter

GYROS, ANGLES = ["p_deg_s", "q_deg_s", "r_deg_s"], ["phi_deg", "theta_deg", "psi_deg"]
COLUMNS = ["score", "score_p", "score_q", "score_r"]
Array = np.ndarray
Score = Callable[[Array, Array, float], Array]  # gyros, angles, Ts -> shape (samples, 4)


def flights(folder: Path, split: str | None = None) -> pd.DataFrame:
    """Return the list of flights: those of a split, or all that have to be scored."""
    listed = pd.read_csv(folder / "flights.csv")
    return listed[listed["split"] == split] if split else listed[listed["split"] != "learn"]


def place(flight: pd.Series) -> str:
    """Return where a flight's file stands."""
    return f"{flight['group']}/{flight['split']}/{flight['flight']}.parquet"


def readings(folder: Path, flight: pd.Series) -> tuple[Array, Array]:
    """Return gyros and angles, shapes (samples, 3)."""
    frame = pd.read_parquet(folder / place(flight), columns=GYROS + ANGLES).ffill()
    return frame[GYROS].to_numpy(), frame[ANGLES].to_numpy()


def increments(gyros: Array, angles: Array, period_s: float) -> Array:
    """Return what each body axis turned from sample to sample by the angles less by its gyro, in deg, shape (n, 3)."""
    phi, theta = np.radians(angles[:, 0]), np.radians(angles[:, 1])
    d_phi, d_theta, d_psi = np.diff(angles, axis=0, prepend=angles[:1]).T
    turned = np.column_stack(
        [
            d_phi - np.sin(theta) * d_psi,
            np.cos(phi) * d_theta + np.sin(phi) * np.cos(theta) * d_psi,
            -np.sin(phi) * d_theta + np.cos(phi) * np.cos(theta) * d_psi,
        ]
    )
    off = turned - gyros * period_s
    off[0] = 0.0
    return off


def by_axis(squares: Array) -> Array:
    """Return the columns of a score file: the greatest of the axes', and each axis's."""
    return np.column_stack([squares.max(axis=1), squares])


def parity(windows_s: tuple[float, ...] = (0.2, 1.0, 5.0)) -> Callable[[list[tuple[Array, Array]], float], Score]:
    """Return a design: parity relations over some windows, each over its deviation on healthy flights."""

    def relations(gyros: Array, angles: Array, period_s: float) -> list[Array]:
        total = np.cumsum(increments(gyros, angles, period_s), axis=0)
        found = []
        for window_s in windows_s:
            rows = round(window_s / period_s)
            off = np.zeros_like(total)
            off[rows:] = total[rows:] - total[:-rows]
            found.append(off)
        return found

    def learn(healthy: list[tuple[Array, Array]], period_s: float) -> Score:
        told = [relations(*each, period_s) for each in healthy]
        deviations = [np.concatenate(of).std(axis=0) for of in zip(*told, strict=True)]

        def score(gyros: Array, angles: Array, period_s: float) -> Array:
            found = relations(gyros, angles, period_s)
            return by_axis(np.max([(off / of) ** 2 for off, of in zip(found, deviations, strict=True)], axis=0))

        return score

    return learn


def unknown_inputs(pole_hz: float = 0.3) -> Callable[[list[tuple[Array, Array]], float], Score]:
    """Return a design: three observers of first order, each decoupled from one gyro's error."""

    def residuals(gyros: Array, angles: Array, period_s: float) -> Array:
        """Return the observers' errors along the body's axes: an observer sees those that it isn't blind to."""
        pole = np.exp(-2.0 * np.pi * pole_hz * period_s)
        return np.asarray(lfilter([1.0], [1.0, -pole], increments(gyros, angles, period_s), axis=0))

    def learn(healthy: list[tuple[Array, Array]], period_s: float) -> Score:
        deviation = np.concatenate([residuals(*each, period_s) for each in healthy]).std(axis=0)

        def score(gyros: Array, angles: Array, period_s: float) -> Array:
            squares = (residuals(gyros, angles, period_s) / deviation) ** 2
            observers = np.column_stack([squares[:, [j for j in range(3) if j != i]].sum(axis=1) for i in range(3)])
            whole = observers.max(axis=1)
            return np.column_stack([whole, whole[:, np.newaxis] - observers])  # the one that is blind to it stays quiet

        return score

    return learn


def imm(wander: float = 0.5, switch_s: float = 60.0) -> Callable[[list[tuple[Array, Array]], float], Score]:
    """Return a design: two filters an axis on the summed increments, of a gyro without an error and with one."""

    def learn(healthy: list[tuple[Array, Array]], period_s: float) -> Score:
        offs = [increments(*each, period_s) for each in healthy]
        lag = np.mean([np.mean(off[1:] * off[:-1], axis=0) for off in offs], axis=0)
        angle = np.maximum(-lag, 1e-8)  # of first differences of white noise the covariance at lag 1 is its variance
        gyro = np.maximum(np.concatenate(offs).var(axis=0) - 2.0 * angle, 1e-8)

        def score(gyros: Array, angles: Array, period_s: float) -> Array:
            return _imm(increments(gyros, angles, period_s), period_s, gyro, angle, wander, period_s / switch_s)

        return score

    return learn


def _imm(off: Array, period_s: float, gyro: Array, angle: Array, wander: float, switch: float) -> Array:
    """Run the filters; modes in the first axis, body axes in the second. The score is the log-odds of an error."""
    mean = np.zeros((2, 3, 2))  # the angle that gyros are off by, and the gyro's error times Ts
    covariance = np.tile(np.diag([1e-3, 1e-12]), (2, 3, 1, 1))
    step = np.array([[1.0, 1.0], [0.0, 1.0]])
    noise = np.zeros((2, 3, 2, 2))
    noise[:, :, 0, 0] = gyro
    noise[1, :, 1, 1] = (wander * period_s) ** 2 * period_s
    chance = np.array([[0.99] * 3, [0.01] * 3])
    moves = np.array([[1.0 - switch, switch], [switch, 1.0 - switch]])
    seen, odds = np.cumsum(off, axis=0), np.zeros_like(off)
    for k, reading in enumerate(seen):
        mixed = moves[:, :, np.newaxis] * chance[:, np.newaxis]  # from, to, axis
        chance = mixed.sum(axis=0)
        weights = mixed / chance
        start = np.einsum("ija,ias->jas", weights, mean)
        apart = mean[:, np.newaxis] - start
        spread = np.einsum("ija,iast->jast", weights, covariance) + np.einsum(
            "ija,ijas,ijat->jast", weights, apart, apart
        )
        start[0, :, 1], spread[0, :, 1, :], spread[0, :, :, 1] = 0.0, 0.0, 0.0  # the healthy gyro has no error
        ahead, spread = start @ step.T, step @ spread @ step.T + noise
        variance = spread[..., 0, 0] + angle
        innovation = reading - ahead[..., 0]
        gain = spread[..., 0] / variance[..., np.newaxis]
        mean = ahead + gain * innovation[..., np.newaxis]
        covariance = spread - gain[..., np.newaxis] * spread[..., np.newaxis, 0, :]
        likely = chance * np.exp(-0.5 * np.minimum(innovation**2 / variance, 600.0)) / np.sqrt(variance)
        chance = np.maximum(likely / likely.sum(axis=0), 1e-300)
        odds[k] = np.log(chance[1] / chance[0])
    return by_axis(odds)


def pyod(kind: str, span_s: float = 0.5) -> Callable[[list[tuple[Array, Array]], float], Score]:
    """Return a detector of PyOD on means and deviations of the sensors over half a second, ten times a second."""

    def features(gyros: Array, angles: Array, period_s: float) -> Array:
        rows = round(span_s / period_s)
        window = pd.DataFrame(np.column_stack([gyros, angles[:, :2]])).rolling(rows, min_periods=1)
        return np.nan_to_num(np.column_stack([window.mean(), window.std()]))

    def learn(healthy: list[tuple[Array, Array]], period_s: float) -> Score:
        from pyod.models.ecod import ECOD
        from pyod.models.iforest import IForest
        from pyod.models.knn import KNN

        every = max(round(0.5 / period_s), 1)
        model = {"ecod": ECOD(), "knn": KNN(), "iforest": IForest(random_state=0)}[kind].fit(
            np.concatenate([features(*each, period_s)[every::every] for each in healthy])
        )

        def score(gyros: Array, angles: Array, period_s: float) -> Array:
            step = max(round(0.1 / period_s), 1)
            told = model.decision_function(features(gyros, angles, period_s)[::step])
            return np.repeat(told, step)[: len(gyros), np.newaxis]  # held until the next: nothing of the future

        return score

    return learn


DESIGNS = {
    "parity-space": parity(),
    "unknown-input-observers": unknown_inputs(),
    "imm": imm(),
    "pyod-knn": pyod("knn"),
    "pyod-iforest": pyod("iforest"),
    "pyod-ecod": pyod("ecod"),
}


def enter(
    source: Path,
    out: Path,
    name: str,
    learn: Callable[[list[tuple[Array, ...]], float], Callable[..., Array]],
    read: Callable[[Path, pd.Series], tuple[Array, ...]] = readings,
    columns: Sequence[str] = COLUMNS,
) -> None:
    """Learn on each group's flights, score its others, and write an entry; `read` says what is seen of a flight."""
    spent_s = samples = 0.0
    for group in flights(source)["group"].unique():
        own = flights(source, "learn")
        own = own[own["group"] == group]
        period_s = float(own["sample_period_s"].iloc[0])
        score = learn([read(source, flight) for _, flight in own.iterrows()], period_s)
        for _, flight in flights(source).query("group == @group").iterrows():
            given = read(source, flight)
            begun_s = time.process_time()
            scores = score(*given, period_s)
            spent_s, samples = spent_s + time.process_time() - begun_s, samples + len(scores)
            frame = pd.DataFrame(scores.astype(np.float32), columns=columns[: scores.shape[1]])
            frame.insert(0, "time_s", np.arange(len(frame)) * period_s)
            path = out / name / place(flight)
            path.parent.mkdir(parents=True, exist_ok=True)
            frame.to_parquet(path, index=False)
    definition = (source / "entry.toml").read_text(encoding="utf-8")
    facts = definition + f'name = "{name}"\nmicroseconds_a_sample = {1e6 * spent_s / samples:.3g}\n'
    (out / name / "entry.toml").write_text(facts, encoding="utf-8")


if __name__ == "__main__":
    source, out, *names = sys.argv[1:]
    for name in names or [each for each in DESIGNS if each != "pyod-ecod"]:
        enter(Path(source), Path(out), name, DESIGNS[name])
        print(f"{name}: {Path(out, name)}")
