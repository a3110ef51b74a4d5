"""Healthy logs as autopilots make them, one for each mechanism that parts gyros and attitude without a broken sensor.

A flight of the GTM is read by noisy gyros and accelerometers; its attitude is an estimator's, which the gyros drive; a
log has all of it at 10 to 50 Hz. A monitor has to watch every one of them without accusing a sensor. What each does is
held against real logs in `tests/testing/test_mechanisms.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gtmbench.bench.attitude_filter import filtered_attitude
from gtmbench.intake.events import Event, EventKind, in_order
from gtmbench.testing.shared_flights import fly_once
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record, Span

CHANNELS = (*GYROS, *ATTITUDE, *ACCELEROMETERS)
_FIRST_SEED = 700_000  # of the flights: nobody else flies them
_STEPS = (2, 4, 5, 10)  # of 10 ms, from one logged sample to the next: 50, 25, 20, 10 Hz
_DURATIONS_S = (60.0, 90.0, 120.0, 200.0)  # by turns
# of an autopilot's sensors: noise and bias of gyros, noise of accelerometers
_NOISE_DEG_S, _BIAS_DEG_S, _NOISE_G = 0.2, 0.1, 0.03
_TIME_CONSTANT_S = 8.0  # of the estimator: how long it trusts the gyros
_WANDER_DEG, _WANDER_S = 0.5, 10.0  # of what it is corrected by

Draw = np.random.Generator


@dataclass(frozen=True, kw_only=True, eq=False)
class Synthetic:
    """A healthy log."""

    record: Record  # p, q, r in deg/s, phi, theta, psi in deg, nx, ny, nz in g
    events: tuple[Event, ...] = ()  # what an autopilot would have logged
    spans: tuple[Span, ...] = ()  # when the mechanism shows, in seconds


def plain(seed: int) -> Synthetic:
    """Return a log without any mechanism: noise, a small bias, an estimator that wanders.

    >>> plain(3).record
    Record(2001 samples, 0..200 s, every 0.1 s: p, q, r, phi, theta, psi, nx, ny, nz)
    """
    return _logged(_read(seed, "plain")[0], seed)


def touchdown(seed: int) -> Synthetic:
    """Return a log that ends on the ground: two bounces, of which the structure rings in gyros and accelerometers.

    The aircraft's own rates stop within a quarter of a second, and the attitude follows. The ringing (20 to 40 Hz, gone
    in 0.15 s) is where the gyros are, not where the estimator looks. The land detector is sure two seconds later.
    """
    truth, draw = _flight(seed), _draw(seed, "touchdown")
    down_s = truth.end_s - draw.uniform(6.0, 9.0)
    bounces_s = [down_s, down_s + draw.uniform(0.3, 0.7)]
    truth = _at_rest(truth, down_s, settling_s=0.25)
    read = _estimated(_sensed(truth, draw), truth, draw)
    for number, time_s in enumerate(bounces_s):
        read = _struck(
            read, time_s, draw, force_g=draw.uniform(1.0, 1.6) / (1 + number), rate_deg_s=25.0 / (1 + number)
        )
    told = (_event(EventKind.TOUCHDOWN, down_s + 2.0, "land detector"),)
    return _logged(read, seed, told, ((down_s, bounces_s[-1] + 0.6),))


def impact(seed: int) -> Synthetic:
    """Return a log that ends in a crash: 5 to 20 g, a tumble that the estimator loses, and rest at another attitude.

    The gyros are right all through; the estimator integrates two thirds of what is beyond 150 deg/s, and comes back.
    """
    truth, draw = _flight(seed), _draw(seed, "impact")
    hit_s = truth.end_s - draw.uniform(6.0, 9.0)
    truth = _tumbled(_at_rest(truth, hit_s, settling_s=0.2), hit_s, draw)
    read = _sensed(truth, draw)
    clipped = [np.clip(read[name], -150.0, 150.0) for name in GYROS]
    followed = [limited + (read[name] - limited) * 2.0 / 3.0 for name, limited in zip(GYROS, clipped, strict=True)]
    guessed = _estimated(_with(read, GYROS, np.column_stack(followed)), truth, draw)
    read = _with(read, ATTITUDE, guessed.matrix(ATTITUDE))
    read = _struck(read, hit_s, draw, force_g=draw.uniform(5.0, 20.0), rate_deg_s=150.0)
    told = (
        _event(EventKind.FAILURE, hit_s + 1.0, "crash check"),
        _event(EventKind.TOUCHDOWN, hit_s + 3.0, "land detector"),
        _event(EventKind.DISARM, hit_s + 3.0, "crash check"),
    )
    return _logged(read, seed, told, ((hit_s, hit_s + 4.0 * _TIME_CONSTANT_S),))


def reset(seed: int) -> Synthetic:
    """Return a log whose estimator sets its attitude anew, five times: headings by 0.1 to 30 deg, tilts by 0.1 to 4.

    From one logged sample to the next, and it stays so; the log counts them.
    """
    read, draw = _read(seed, "reset")
    told, spans = [], []
    for time_s in _apart(read, draw, 5):
        heading = draw.choice([-1.0, 1.0]) * np.exp(draw.uniform(np.log(0.1), np.log(30.0)))
        tilts = draw.choice([-1.0, 1.0], 2) * np.exp(draw.uniform(np.log(0.1), np.log(4.0), 2)) * (draw.random() < 0.5)
        since = read.time_s >= time_s
        read = _with(read, ATTITUDE, read.matrix(ATTITUDE) + since[:, np.newaxis] * np.array([*tilts, heading]))
        by_deg = float(np.linalg.norm([*tilts, heading]))
        told.append(_event(EventKind.RESET, time_s, f"attitude by {by_deg:.2g} deg"))
        spans.append((time_s, time_s))
    return _logged(read, seed, told, spans)


def held(seed: int) -> Synthetic:
    """Return a log whose attitude is fresh at 10 to 20 Hz only, and held between, beside gyros at 50 Hz."""
    read, draw = _read(seed, "held")
    return _logged(_holding(read, every=int(draw.choice([5, 6, 8, 10]))), 0)


def hardly_fresh(seed: int) -> Synthetic:
    """Return a log whose attitude is logged at 20 Hz and fresh at 2.5 Hz, as a telemetry link thins it."""
    read, _ = _read(seed, "hardly fresh")
    return _logged(_holding(read, every=40), 2)


def late(seed: int) -> Synthetic:
    """Return a log whose attitude is 0.05 to 0.3 s late, all three angles alike."""
    read, _ = _read(seed, "late")
    at_s = read.time_s - late_s(seed)
    angles = [np.interp(at_s, read.time_s, read[name]) for name in ATTITUDE]
    return _logged(_with(read, ATTITUDE, np.column_stack(angles)), seed)


def late_s(seed: int) -> float:
    """Return how late the attitude of `late` is."""
    return float(_draw(seed, "how late").uniform(0.05, 0.3))


def vibration(seed: int) -> Synthetic:
    """Return a log whose gyros' noise is three times as strong at high throttle, with a tone that the log folds down.

    The throttle changes every ten seconds or so. The estimator doesn't see it: it averages over many more samples.
    """
    read, draw = _read(seed, "vibration")
    throttle = _steps(len(read), read.sample_period_s, draw, every_s=10.0)
    strength = 1.0 + 2.0 * throttle
    turns = np.cumsum(31.0 + 12.0 * throttle) * read.sample_period_s  # of the motors, at 31 to 43 Hz
    shaken = draw.standard_normal((len(read), 3)) + np.sqrt(2.0) * np.sin(
        2 * np.pi * (turns[:, np.newaxis] + draw.random(3))
    )
    return _logged(_with(read, GYROS, read.matrix(GYROS) + 0.5 * strength[:, np.newaxis] * shaken), seed)


def model_error(seed: int) -> Synthetic:
    """Return a log whose gyros are 2 % and 1 deg off, with an error that grows with motion and isn't Gaussian.

    What an installation leaves: scale, misalignment, and gains that vary by some per cent, at times by much more.
    """
    read, draw = _read(seed, "model error")
    scale = 1.0 + 0.02 * draw.choice([-1.0, 1.0], 3)
    axis = draw.standard_normal(3)
    x, y, z = np.radians(1.0) * axis / np.linalg.norm(axis)
    turned = read.matrix(GYROS) @ np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]])
    varying = _slow(draw.standard_t(3.0, (len(read), 3)), read.sample_period_s, 0.2)
    varying *= 0.06 / varying.std(axis=0)
    size = np.linalg.norm(turned, axis=1)[:, np.newaxis]
    return _logged(_with(read, GYROS, turned * scale + varying * size), seed)


def handling(seed: int) -> Synthetic:
    """Return a log that begins in somebody's hands: turned about for 20 s, heading not aligned before it flies."""
    truth, draw = _flight(seed), _draw(seed, "handling")
    off_s = 20.0
    truth = _carried(truth, off_s, draw)
    read = _estimated(_sensed(truth, draw), truth, draw)
    wrong = draw.choice([-1.0, 1.0]) * draw.uniform(10.0, 30.0)  # deg, and going
    left = np.where(read.time_s < off_s, wrong * np.exp(-read.time_s / 5.0), 0.0)
    read = read.replace("psi", read["psi"] + left)
    told = (_event(EventKind.ARM, off_s - 2.0, "commander"), _event(EventKind.TAKEOFF, off_s, "land detector"))
    return _logged(read, seed, told, ((0.0, off_s),))


MECHANISMS: dict[str, Callable[[int], Synthetic]] = {
    "plain": plain,
    "touchdown": touchdown,
    "impact": impact,
    "reset": reset,
    "held samples": held,
    "hardly fresh": hardly_fresh,
    "late attitude": late,
    "vibration": vibration,
    "model error": model_error,
    "handling": handling,
}


def _draw(seed: int, name: str) -> Draw:
    return np.random.default_rng([seed, *name.encode()])


def _flight(seed: int) -> Record:
    """Return the truth, at 100 Hz."""
    return fly_once(duration_s=_DURATIONS_S[seed % len(_DURATIONS_S)], seed=_FIRST_SEED + seed).select(CHANNELS)


def _read(seed: int, name: str) -> tuple[Record, Draw]:
    """Return what sensors and an estimator make of a flight, and what is drawn from next."""
    truth, draw = _flight(seed), _draw(seed, name)
    return _estimated(_sensed(truth, draw), truth, draw), draw


def _with(record: Record, channels: Sequence[str], values: FloatArray) -> Record:
    for name, column in zip(channels, values.T, strict=True):
        record = record.replace(name, column)
    return record


def _event(kind: EventKind, time_s: float, text: str) -> Event:
    return Event(kind=kind, time_s=time_s, text=text)


def _sensed(truth: Record, draw: Draw) -> Record:
    rates = truth.matrix(GYROS) + _BIAS_DEG_S * draw.standard_normal(3)
    rates = rates + _NOISE_DEG_S * draw.standard_normal(rates.shape)
    forces = truth.matrix(ACCELEROMETERS)
    return _with(_with(truth, GYROS, rates), ACCELEROMETERS, forces + _NOISE_G * draw.standard_normal(forces.shape))


def _estimated(sensed: Record, truth: Record, draw: Draw) -> Record:
    """Return it with the attitude of an estimator, which the gyros drive and a wandering reference corrects."""
    wander = _slow(draw.standard_normal((len(truth), 3)), truth.sample_period_s, _WANDER_S)
    reference = truth.matrix(ATTITUDE) + _WANDER_DEG * wander / wander.std(axis=0)
    return filtered_attitude(
        _with(sensed, ATTITUDE, reference), time_constant_s=_TIME_CONSTANT_S, seed=int(draw.integers(2**31))
    )


def _logged(record: Record, seed: int, events: Sequence[Event] = (), spans: Sequence[Span] = ()) -> Synthetic:
    """Return what a log keeps: every so many samples, as they are."""
    every = _STEPS[seed % len(_STEPS)]
    kept = Record(
        record.values[::every],
        channels=record.channels,
        sample_period_s=record.sample_period_s * every,
        start_s=record.start_s,
    )
    shown = spans or [(record.start_s, record.end_s)]
    return Synthetic(
        record=kept, events=in_order(events), spans=tuple((start_s, min(end_s, kept.end_s)) for start_s, end_s in shown)
    )


def _slow(values: FloatArray, period_s: float, time_constant_s: float) -> FloatArray:
    """Return columns through a first-order lag."""
    from scipy.signal import lfilter

    share = period_s / (time_constant_s + period_s)
    return np.asarray(lfilter([share], [1.0, share - 1.0], values, axis=0))


def _steps(rows: int, period_s: float, draw: Draw, *, every_s: float) -> FloatArray:
    """Return a level between 0 and 1 that changes every so often, within a second; both ends are reached."""
    count = max(2, round(rows * period_s / every_s))
    levels = draw.permutation(np.linspace(0.0, 1.0, count))
    raw = np.repeat(levels, -(-rows // count))[:rows]
    return _slow(raw, period_s, 0.3)


def _apart(truth: Record, draw: Draw, count: int) -> list[float]:
    """Return times that lie a few seconds apart, all over a flight."""
    edges = np.linspace(truth.start_s + 3.0, truth.end_s - 3.0, count + 1)
    return [round(float(draw.uniform(first + 0.2 * (last - first), last)), 2) for first, last in pairwise(edges)]


def _moved(truth: Record, rates: FloatArray, since: int) -> Record:
    """Return a flight whose attitude is the integral of other rates from a sample on."""
    path = filtered_attitude(
        _with(truth, GYROS, rates).between(truth.time_s[since], truth.end_s),
        time_constant_s=1e12,  # a time constant that leaves the gyros' integral alone
        reference_noise_deg=0.0,
    ).matrix(ATTITUDE)
    angles = np.concatenate([truth.matrix(ATTITUDE)[:since], path])
    return _with(_with(truth, GYROS, rates), ATTITUDE, angles)


def _at_rest(truth: Record, since_s: float, *, settling_s: float) -> Record:
    """Return a flight that comes to rest: its rates die away, and what is felt is weight."""
    since = int(np.searchsorted(truth.time_s, since_s))
    fading = np.exp(-(truth.time_s[since:] - truth.time_s[since]) / settling_s)[:, np.newaxis]
    rates, forces = truth.matrix(GYROS).copy(), truth.matrix(ACCELEROMETERS).copy()
    rates[since:] = rates[since] * fading
    stopped = _moved(truth, rates, since)
    phi, theta, _ = np.radians(stopped.matrix(ATTITUDE)[since:]).T
    weight = np.column_stack([np.sin(theta), -np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)])
    forces[since:] = weight + (forces[since] - weight) * fading
    return _with(stopped, ACCELEROMETERS, forces)


def _tumbled(truth: Record, since_s: float, draw: Draw) -> Record:
    """Return a flight with a tumble: hundreds of deg/s about the long axis and heading, gone within two seconds."""
    since = int(np.searchsorted(truth.time_s, since_s))
    elapsed = truth.time_s[since:] - truth.time_s[since]
    course = (elapsed / 0.1 * np.exp(1.0 - elapsed / 0.1) + np.exp(-elapsed / 0.5) * np.sin(9.0 * elapsed))[
        :, np.newaxis
    ]
    sizes = draw.choice([-1.0, 1.0], 3) * draw.uniform([200.0, 20.0, 100.0], [400.0, 60.0, 250.0])
    rates = truth.matrix(GYROS).copy()
    rates[since:] += course * sizes
    return _moved(truth, rates, since)


def _struck(record: Record, time_s: float, draw: Draw, *, force_g: float, rate_deg_s: float) -> Record:
    """Return a record with a blow: a pulse of force, and the structure's ringing in gyros and accelerometers."""
    elapsed = record.time_s - time_s
    after = elapsed >= 0.0
    since = np.where(after, elapsed, 0.0)
    pulse = np.where(after, np.exp(-since / 0.05), 0.0)
    ringing = np.where(after, np.exp(-since / 0.15), 0.0)[:, np.newaxis]
    turns = draw.uniform(20.0, 40.0, 6) * since[:, np.newaxis] + draw.random(6)
    rings = ringing * np.sin(2 * np.pi * turns) * draw.uniform(0.5, 1.0, 6)
    rates = record.matrix(GYROS) + rate_deg_s * rings[:, :3]
    forces = record.matrix(ACCELEROMETERS) + 0.5 * force_g * rings[:, 3:]
    forces[:, 2] += force_g * pulse
    return _with(_with(record, GYROS, rates), ACCELEROMETERS, forces)


def _holding(record: Record, *, every: int) -> Record:
    """Return a record whose attitude is fresh every so many samples only."""
    return _with(record, ATTITUDE, record.matrix(ATTITUDE)[np.arange(len(record)) // every * every])


def _carried(truth: Record, until_s: float, draw: Draw) -> Record:
    """Return a flight before which somebody turns the aircraft about; rates and weight are those of that motion."""
    until = int(np.searchsorted(truth.time_s, until_s))
    time_s = truth.time_s[:until]
    hold = (np.clip(time_s / 3.0, 0.0, 1.0) * np.clip((until_s - time_s) / 4.0, 0.0, 1.0)) ** 2
    waves = np.sin(2 * np.pi * (draw.uniform(0.1, 0.5, (3, 3, 1)) * time_s + draw.random((3, 3, 1)))).sum(axis=1)
    angles = truth.matrix(ATTITUDE)[until] + (hold * waves * np.array([[12.0], [6.0], [20.0]])).T
    phi_rate, theta_rate, psi_rate = np.gradient(angles, truth.sample_period_s, axis=0).T
    phi, theta, _ = np.radians(angles).T
    rates = np.column_stack(
        [
            phi_rate - psi_rate * np.sin(theta),
            theta_rate * np.cos(phi) + psi_rate * np.cos(theta) * np.sin(phi),
            psi_rate * np.cos(theta) * np.cos(phi) - theta_rate * np.sin(phi),
        ]
    )
    weight = np.column_stack([np.sin(theta), -np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)])
    values = truth.matrix(CHANNELS).copy()
    values[:until] = np.column_stack([rates, angles, weight])
    return _with(truth, CHANNELS, values)
