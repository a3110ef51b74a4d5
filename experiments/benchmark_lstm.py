"""A learnt rival enters gtmbench-2 by files: a recurrent network predicts the sensors, its smoothed errors are scores.

    pip install 'gtmbench[learnt]'
    gtmbench benchmark --quick --export flights
    KERAS_BACKEND=jax python experiments/benchmark_lstm.py flights entries
    gtmbench benchmark --quick --score entries/lstm

Hundman and others 2018 (Detecting Spacecraft Anomalies Using LSTMs and Nonparametric Dynamic Thresholding, KDD;
"telemanom"), with the authors' settings: two layers of 80 units, dropout 0.3, windows of 250 steps, ten steps
predicted, mean squared error, Adam at 0.001, batches of 64, a fifth of the windows held out, at most 35 epochs,
patience 10 for 0.0003, errors smoothed by an exponential mean over 105 steps. It learns on flights of `learn` alone.

What differs, and why: one network for all six sensors instead of one each, since it sees all readings and commands;
ten steps a second, since the authors' data are slow; a prediction at every step of a window instead of the last one
alone, so that it learns in minutes; the benchmark's thresholds instead of the authors' own, which look at the future.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import keras
import numpy as np
import pandas as pd
from scipy.signal import lfilter

from benchmark_entries import ANGLES, GYROS, Array, enter, place

OTHERS = ["alpha_deg", "beta_deg", "nx_g", "ny_g", "nz_g", "tas_kt"]
COMMANDS = ["elevator_deg", "aileron_deg", "rudder_deg", "throttle_percent"]
NAMES = ["p", "q", "r", "phi", "theta", "psi"]
COLUMNS = ["score", *(f"score_{name}" for name in NAMES)]
STEP_S, WINDOW, AHEAD, SMOOTHED = 0.1, 250, 10, 105
EVERY = 25  # steps from window to window


def everything(folder: Path, flight: pd.Series) -> tuple[Array]:
    """Return all that is seen of a flight, shape (samples, 16): sensors, other readings, commands."""
    columns = GYROS + ANGLES + OTHERS + COMMANDS
    return (pd.read_parquet(folder / place(flight), columns=columns).ffill()[columns].to_numpy(),)


def steps(values: Array, rows: int) -> Array:
    """Return means over so many rows, shape (steps, 16); of the heading its change, which has no ends."""
    values = values.copy()
    change = np.diff(values[:, 5], prepend=values[0, 5])
    values[:, 5] = (change + 180.0) % 360.0 - 180.0
    count = len(values) // rows
    means: Array = values[: count * rows].reshape(count, rows, -1).mean(axis=1)
    return means


def network(inputs: int) -> keras.Model:
    """Return the authors' layers: what comes in so far, to the next ten steps of six sensors."""
    model = keras.Sequential(
        [
            keras.layers.Input((None, inputs)),
            keras.layers.LSTM(80, return_sequences=True),
            keras.layers.Dropout(0.3),
            keras.layers.LSTM(80, return_sequences=True),
            keras.layers.Dropout(0.3),
            keras.layers.Dense(AHEAD * len(NAMES)),
        ]
    )
    model.compile(optimizer=keras.optimizers.Adam(0.001), loss="mse")
    return model


def windows(flight: Array) -> tuple[Array, Array]:
    """Return what windows see and what they should predict, shapes (windows, 250, 16) and (windows, 250, 60)."""
    starts = range(0, len(flight) - WINDOW - AHEAD, EVERY)
    seen = [flight[k : k + WINDOW] for k in starts]
    ahead = np.lib.stride_tricks.sliding_window_view(flight[1:, : len(NAMES)], AHEAD, axis=0)  # step, sensor, ahead
    due = [ahead[k : k + WINDOW].reshape(WINDOW, -1) for k in starts]
    return np.stack(seen), np.stack(due)


def learn(healthy: list[tuple[Array, ...]], period_s: float) -> Callable[[Array, float], Array]:
    """Fit the network on healthy flights, and return the score of another."""
    keras.utils.set_random_seed(0)
    rows = max(round(STEP_S / period_s), 1)
    flown = [steps(values, rows) for (values,) in healthy]
    mean, deviation = np.concatenate(flown).mean(axis=0), np.concatenate(flown).std(axis=0)
    flown = [(each - mean) / deviation for each in flown]
    seen, due = (np.concatenate(of) for of in zip(*map(windows, flown), strict=True))
    order = np.random.default_rng(0).permutation(len(seen))
    model = network(seen.shape[2])
    stop = keras.callbacks.EarlyStopping(patience=10, min_delta=0.0003, restore_best_weights=True)
    told = model.fit(
        seen[order], due[order], batch_size=64, epochs=35, validation_split=0.2, callbacks=[stop], verbose=0
    )
    print(f"{len(told.history['loss'])} epochs, held-out loss {min(told.history['val_loss']):.4f}")
    longest = max(map(len, flown))

    def errors(flight: Array) -> Array:
        """Return smoothed errors of the next step, shape (steps, 6)."""
        padded = np.pad(flight, ((0, longest - len(flight)), (0, 0)))  # one length: the same arithmetic for all
        ahead = np.asarray(model(padded[np.newaxis], training=False))[0].reshape(longest, len(NAMES), AHEAD)
        off = np.zeros((len(flight), len(NAMES)))
        off[1:] = np.abs(flight[1:, : len(NAMES)] - ahead[: len(flight) - 1, :, 0])
        weight = 2.0 / (SMOOTHED + 1.0)
        return np.asarray(lfilter([weight], [1.0, weight - 1.0], off, axis=0))

    usual = np.sqrt(np.mean(np.concatenate([errors(each) for each in flown]) ** 2, axis=0))

    def score(values: Array, _period_s: float) -> Array:
        ratios = (errors((steps(values, rows) - mean) / deviation) / usual) ** 2
        held = np.zeros((len(values), len(NAMES)))
        known = (np.arange(rows - 1, len(values)) + 1) // rows - 1  # a step is known at its last row
        held[rows - 1 :] = ratios[known]
        return np.column_stack([held.max(axis=1), held])

    return score


if __name__ == "__main__":
    source, out = map(Path, sys.argv[1:])
    enter(source, out, "lstm", learn, everything, COLUMNS)
    print(f"lstm: {out / 'lstm'}")
