"""Pseudo inputs from kinematics: channels that tell what a gyro should read, whatever excites the aircraft.

An operator that is identified from sensor to sensor learns what the excitation of its record made of them. Kinematics
holds for every excitation, so it goes first, and an identified FIR model from the result to the gyro comes second: it
takes up filters, delays and gains that nobody declared.

Derivatives are central differences, x'(k) = (x(k+1) - x(k-1)) / (2 Ts), so row k is known one sample later and the
first and last rows are missing. Angles in the formulas are radians; what comes out is in the units of the table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.channels import unit_of
from gtmbench.checks import names
from gtmbench.errors import InputError
from gtmbench.record import FloatArray, Record, check_record

_G = 9.80665  # m/s2
_M_S_PER_KT = 1852.0 / 3600.0

Read = Callable[[str], FloatArray]  # a channel by name, angles in radians, kt in m/s
Slope = Callable[[str], FloatArray]  # its derivative


@dataclass(frozen=True, kw_only=True)
class PseudoInput:
    """A transformation of channels.

    Attributes
    ----------
    name, unit : str
    needs : tuple of str
        Channels, or other pseudo inputs.
    formula : str
        As it is computed, a prime being d/dt.
    meaning : str
        Where it comes from.
    reproduces : str or None
        The sensor that it reads as, but for lags and gains.
    """

    name: str
    unit: str
    needs: tuple[str, ...]
    formula: str
    meaning: str
    compute: Callable[[Read, Slope], FloatArray] = field(repr=False)
    reproduces: str | None = None


def _p_att(x: Read, d: Slope) -> FloatArray:
    return d("phi") - d("psi") * np.sin(x("theta"))


def _q_att(x: Read, d: Slope) -> FloatArray:
    return d("theta") * np.cos(x("phi")) + d("psi") * np.cos(x("theta")) * np.sin(x("phi"))


def _r_att(x: Read, d: Slope) -> FloatArray:
    return d("psi") * np.cos(x("theta")) * np.cos(x("phi")) - d("theta") * np.sin(x("phi"))


def _r_lat(x: Read, d: Slope) -> FloatArray:
    forward = x("tas") * np.cos(x("alpha")) * np.cos(x("beta"))
    forward = np.where(np.abs(forward) > 1.0, forward, np.nan)  # m/s: standing still, it says nothing
    return _G * (np.sin(x("phi")) * np.cos(x("theta")) + x("ny")) / forward + d("phi") * np.tan(x("alpha"))


def _q_from(yaw: str) -> Callable[[Read, Slope], FloatArray]:
    return lambda x, d: (d("theta") + x(yaw) * np.sin(x("phi"))) / np.cos(x("phi"))


def _p_from(yaw: str) -> Callable[[Read, Slope], FloatArray]:
    def compute(x: Read, d: Slope) -> FloatArray:
        pitch = _q_from(yaw)(x, d)
        return d("phi") - np.tan(x("theta")) * (pitch * np.sin(x("phi")) + x(yaw) * np.cos(x("phi")))

    return compute


def _slope_of(channel: str) -> PseudoInput:
    return PseudoInput(
        name=f"{channel}_rate",
        unit="deg/s",
        needs=(channel,),
        formula=f"{channel}'",
        meaning="central difference",
        compute=lambda _, d: d(channel),
    )


def _rate(
    name: str, needs: str, formula: str, meaning: str, compute: Callable[[Read, Slope], FloatArray]
) -> PseudoInput:
    return PseudoInput(
        name=name,
        unit="deg/s",
        needs=tuple(needs.split()),
        formula=formula,
        meaning=meaning,
        compute=compute,
        reproduces=name.partition("_")[0],
    )


_EULER = "Euler kinematics of a yaw-pitch-roll attitude"
_LATERAL = "lateral specific force, in coordinated flight: no heading needed"
_TURN = "Euler kinematics without heading, yaw rate from its gyro"
_Q = "(theta' + {0} sin phi) / cos phi"
_P = "phi' - tan theta (q sin phi + {0} cos phi), q = (theta' + {0} sin phi) / cos phi"

PSEUDO_INPUTS: dict[str, PseudoInput] = {
    item.name: item
    for item in (
        _rate("p_att", "phi theta psi", "phi' - psi' sin theta", _EULER, _p_att),
        _rate("q_att", "phi theta psi", "theta' cos phi + psi' cos theta sin phi", _EULER, _q_att),
        _rate("r_att", "phi theta psi", "psi' cos theta cos phi - theta' sin phi", _EULER, _r_att),
        _rate(
            "r_lat",
            "phi theta alpha beta ny tas",
            "g (sin phi cos theta + ny) / u + phi' tan alpha, u = tas cos alpha cos beta",
            _LATERAL,
            _r_lat,
        ),
        _rate("q_lat", "phi theta r_lat", _Q.format("r_lat"), _LATERAL, _q_from("r_lat")),
        _rate("p_lat", "phi theta r_lat", _P.format("r_lat"), _LATERAL, _p_from("r_lat")),
        _rate("q_turn", "phi theta r", _Q.format("r"), _TURN, _q_from("r")),
        _rate("p_turn", "phi theta r", _P.format("r"), _TURN, _p_from("r")),
        *(_slope_of(channel) for channel in ("phi", "theta", "psi", "alpha", "beta")),
    )
}


def derive(record: Record, wanted: Sequence[str] | str) -> Record:
    """Return the record with pseudo inputs added as channels, for any operator.

    Parameters
    ----------
    record : Record
        With angles in deg and rates in deg/s, as everywhere. A heading may run from 360 deg to 0.
    wanted : sequence of str
        Names of `PSEUDO_INPUTS`; what they need on the way is computed, not added. Channels that the record has
        already are left as they are.

    Raises
    ------
    InputError
        Where a name is unknown, or channels are missing: what can be built from those that are there is said.

    Examples
    --------
    >>> record = Record([[0.0, 0.0], [0.3, 0.0], [0.6, 0.0]], channels=["phi", "theta"], sample_period_s=0.1)
    >>> derive(record, ["phi_rate"])["phi_rate"]
    array([nan,  3., nan])
    """
    check_record(record)
    new = [name for name in names("pseudo inputs", wanted) if name not in record]
    for name in new:
        check_derivable(name, record.channels)
    if not new:
        return record
    cache: dict[str, FloatArray] = {}
    slopes: dict[str, FloatArray] = {}
    values = np.empty((len(record), len(record.channels) + len(new)), order="F")  # as records are: no transposing
    values[:, : len(record.channels)] = record.values
    for i, name in enumerate(new, len(record.channels)):
        values[:, i] = np.rad2deg(_computed(name, record, cache, slopes))
    return Record(
        values,
        channels=[*record.channels, *new],
        sample_period_s=record.sample_period_s,
        start_s=record.start_s,
    )


def derivable(channels: Iterable[str]) -> tuple[str, ...]:
    """Return the pseudo inputs that can be built from some channels.

    >>> derivable(["phi", "theta", "psi"])[:3]
    ('p_att', 'q_att', 'r_att')
    """
    return tuple(name for name in PSEUDO_INPUTS if raw_needs(name) <= set(channels))


def check_derivable(name: str, channels: Iterable[str]) -> None:
    """Refuse a pseudo input that is unknown or lacks channels, and say what can be built instead."""
    if name not in PSEUDO_INPUTS:
        raise InputError(f"no channel and no pseudo input '{name}'; there are {', '.join(PSEUDO_INPUTS)}")
    there = set(channels)
    missing = sorted(raw_needs(name) - there)
    if missing:
        possible = ", ".join(derivable(there)) or "none"
        raise InputError(
            f"'{name}' needs {', '.join(sorted(raw_needs(name)))}, and {', '.join(missing)} isn't there; from these "
            f"channels can be built: {possible}"
        )


def raw_needs(name: str) -> set[str]:
    """Return the measured channels behind a channel or a pseudo input, through all steps.

    >>> sorted(raw_needs("q_lat"))
    ['alpha', 'beta', 'ny', 'phi', 'tas', 'theta']
    """
    if name not in PSEUDO_INPUTS:
        return {name}
    return {raw for need in PSEUDO_INPUTS[name].needs for raw in raw_needs(need)}


def factor_of(name: str) -> float:
    """Return what turns a channel into radians, m/s or g, as the formulas take it."""
    unit = PSEUDO_INPUTS[name].unit if name in PSEUDO_INPUTS else unit_of(name)
    return _M_S_PER_KT if unit == "kt" else np.pi / 180.0 if "deg" in unit else 1.0


def _computed(name: str, record: Record, cache: dict[str, FloatArray], slopes: dict[str, FloatArray]) -> FloatArray:
    """Return a channel or a pseudo input in radians, m/s or g."""
    if name not in cache:
        if name in record:
            cache[name] = record[name] * factor_of(name)
        else:

            def read(channel: str) -> FloatArray:
                return _computed(channel, record, cache, slopes)

            def slope(channel: str) -> FloatArray:
                if channel not in slopes:
                    slopes[channel] = _slope(read(channel), record.sample_period_s)
                return slopes[channel]

            cache[name] = PSEUDO_INPUTS[name].compute(read, slope)
    return cache[name]


def _slope(values: FloatArray, sample_period_s: float) -> FloatArray:
    slope = np.full(len(values), np.nan)
    steps = values[2:] - values[:-2]
    turned = np.abs(steps) > np.pi  # a heading that runs from 360 deg to 0
    steps[turned] -= 2.0 * np.pi * np.rint(steps[turned] / (2.0 * np.pi))
    slope[1:-1] = steps / (2.0 * sample_period_s)
    return slope
