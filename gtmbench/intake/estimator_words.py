"""What an estimator logs of its own opinion: the gyro biases that it subtracts, and whether it rejects a sensor.

It is reported beside a verdict and never used: a verdict that rested on it couldn't be compared with it.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.errors import InputError
from gtmbench.intake.formats.raw import RawLog, RawSeries
from gtmbench.intake.read import ReadLog
from gtmbench.intake.stamps import cleaned_alone
from gtmbench.intake.times import with_time
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

BIAS, RATIO = "gyro bias", "test ratio"
_FEWEST = 10  # rows

_DEG = 180.0 / np.pi  # a radian
_STEP_S = 0.01  # of PX4's filter; where a gyro's period doesn't go into it, up to a fifth shorter or longer
# topics, and what their fields mean, by what is estimated or tested; of each the first that a log has
_BIASES: Sequence[tuple[str, Mapping[str, str], float]] = (
    (r"estimator_sensor_bias(#0)?", {name: f"gyro_bias[{axis}]" for axis, name in enumerate(GYROS)}, _DEG),
    # until 2020: attitude, velocity, position, and what is taken off the angle that a gyro turns in a step
    (r"estimator_status(#0)?", {name: f"states[{10 + axis}]" for axis, name in enumerate(GYROS)}, _DEG / _STEP_S),
    (r"(X|N)KF1(#0)?|EKF1", dict(zip(GYROS, ("GX", "GY", "GZ"), strict=True)), 1.0),
)
_RATIOS: Sequence[tuple[str, Mapping[str, Sequence[str]]]] = (
    (
        r"estimator_innovation_test_ratios(#0)?",
        {
            "magnetometer": ("mag_field[0]", "mag_field[1]", "mag_field[2]"),
            "heading": ("heading",),
            "gps velocity": ("gps_hvel[0]", "gps_hvel[1]", "gps_vvel"),
            "pressure altitude": ("baro_vpos",),
            "airspeed": ("airspeed",),
        },
    ),
    (
        r"estimator_status(#0)?",
        {
            "magnetometer": ("mag_test_ratio",),
            "gps velocity": ("vel_test_ratio",),
            "height": ("hgt_test_ratio",),
            "airspeed": ("tas_test_ratio",),
        },
    ),
    (r"(X|N)KF4(#0)?", {"magnetometer": ("SM",), "gps velocity": ("SV",), "height": ("SH",), "airspeed": ("SVT",)}),
    (  # of 2014
        r"EKF4",
        {"magnetometer": ("SMX", "SMY", "SMZ"), "gps velocity": ("SV",), "height": ("SH",), "airspeed": ("SVT",)},
    ),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatorWord:
    """A quantity that an estimator logs of its opinion."""

    # `BIAS`, in deg/s; or `RATIO`, of an innovation to what the estimator accepts: beyond 1 it rejects the sensor
    quantity: str
    of: str  # the gyro, or what is tested
    columns: tuple[str, ...]
    time_s: FloatArray = field(repr=False)  # time_s, values: shape (rows,); of several axes the largest ratio
    values: FloatArray = field(repr=False)


def estimator_words_of(log: ReadLog) -> tuple[EstimatorWord, ...]:
    """Return what a log's first estimator says of gyros and of other sensors; none where its format tells nothing."""
    raw = log.raw
    with contextlib.suppress(InputError):  # whoever opens the log says why its time isn't known
        raw = with_time(raw, None)
    by_name = {series.name: series for series in raw.series}
    with np.errstate(all="ignore"):  # broken logs hold signalling NaNs and numbers that overflow
        return tuple(each for each in (*_biases(raw, by_name), *_ratios(raw, by_name)) if each is not None)


def _biases(raw: RawLog, by_name: Mapping[str, RawSeries]) -> Iterator[EstimatorWord | None]:
    for pattern, fields, factor in _BIASES:
        topic = _topic(pattern, raw, by_name, fields.values())
        if topic is not None and _begins_with_attitude(topic, by_name):
            words = [_word(BIAS, gyro, [by_name[f"{topic}.{name}"]], raw, factor) for gyro, name in fields.items()]
            if any(words):  # else a topic of few rows, and the next may tell
                yield from words
                return


def _begins_with_attitude(topic: str, by_name: Mapping[str, RawSeries]) -> bool:
    """Tell whether states, where a topic has them, are those of PX4's filter: other estimators log others there."""
    states = [by_name.get(f"{topic}.states[{place}]") for place in range(4)]
    told = [each.values() for each in states if each is not None]
    # an attitude's quaternion has a length of nearly 1
    return not told or abs(float(np.median(np.linalg.norm(told, axis=0))) - 1.0) < 0.01


def _ratios(raw: RawLog, by_name: Mapping[str, RawSeries]) -> Iterator[EstimatorWord | None]:
    for pattern, fields in _RATIOS:
        topic = _topic(pattern, raw, by_name, fields["magnetometer"])
        if topic is not None:
            for of, names in fields.items():
                own = [by_name[f"{topic}.{name}"] for name in names if f"{topic}.{name}" in by_name]
                yield _word(RATIO, of, own, raw, 1.0) if own else None
            return


def _topic(pattern: str, raw: RawLog, by_name: Mapping[str, RawSeries], names: Iterable[str]) -> str | None:
    """Return the first topic of a pattern that has some fields."""
    wanted = list(names)
    for topic in sorted(raw.clocks):
        if re.fullmatch(pattern, topic) and all(f"{topic}.{name}" in by_name for name in wanted):
            return topic
    return None


def _word(quantity: str, of: str, series: Sequence[RawSeries], raw: RawLog, factor: float) -> EstimatorWord | None:
    """Return a quantity's values where it has any; None where it hasn't, or when isn't known."""
    clock = cleaned_alone(raw.clocks[series[0].clock])
    if clock is None:
        return None
    columns = np.array([each.values() for each in series])[:, clock.rows] * factor
    values = columns[0] if quantity == BIAS else np.fmax.reduce(columns)
    known = np.isfinite(values)
    if np.count_nonzero(known) < _FEWEST or not np.any(values[known]):
        return None  # the estimator doesn't use the sensor
    return EstimatorWord(
        quantity=quantity,
        of=of,
        columns=tuple(each.name for each in series),
        time_s=clock.time_s[known],
        values=values[known],
    )
