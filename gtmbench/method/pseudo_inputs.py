"""Pseudo inputs from kinematics: channels that tell what a gyro should read, whatever excites the aircraft.

An operator that is identified from sensor to sensor learns what the excitation of its record made of them. Kinematics
holds for every excitation, so it goes first, and an identified FIR model from the result to the gyro comes second: it
takes up filters, delays and gains that nobody declared.

Derivatives are central differences, x'(k) = (x(k+1) - x(k-1)) / (2 Ts), so row k is known one sample later and the
first and last rows are missing. Angles in the formulas are radians; what comes out is in the units of the table.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from gtmbench.checks import meant, names
from gtmbench.errors import InputError
from gtmbench.values.channels import G_M_S2, unit_of
from gtmbench.values.record import FloatArray, Record, check_record, with_columns

Values = float | FloatArray  # of one sample, or of a record

_STEP = 1e-5  # of a derivative, in the formulas' units
_M_S_PER_KT = 1852.0 / 3600.0  # by definition of the nautical mile
_BLOCK = 4096  # rows at a time: what is worked out of them stays in the cache


class Motion:
    """What the formulas read: channels, pseudo inputs, derivatives, sines, each worked out once."""

    def __init__(
        self, measured: Container[str], channel: Callable[[str], Values], slope: Callable[[str], Values]
    ) -> None:
        self._measured, self._channel, self._slope = measured, channel, slope
        self._known: dict[tuple[str, str], Values] = {}

    def moved(self, channel: str, value: float, slope: float) -> Motion:
        """Return the motion with another value and slope of one channel; what that leaves alone is known already."""
        other = Motion(self._measured, self._channel, self._slope)
        kept = {key: values for key, values in self._known.items() if key[1] in self._measured and key[1] != channel}
        other._known = kept | {("", channel): self(channel) + value, ("'", channel): self.slope(channel) + slope}
        return other

    def __call__(self, name: str) -> Values:
        """Return a channel or a pseudo input, in radians, m/s or g."""
        if name in self._measured:
            return self._once("", name, self._channel)
        return self._once("", name, lambda _: PSEUDO_INPUTS[name].compute(self))

    def slope(self, channel: str) -> Values:
        """Return a channel's derivative."""
        return self._once("'", channel, self._slope)

    def sin(self, name: str) -> Values:
        """Return the sine of an angle."""
        return self._once("sin", name, lambda _: np.sin(self(name)))

    def cos(self, name: str) -> Values:
        """Return the cosine of an angle."""
        return self._once("cos", name, lambda _: np.cos(self(name)))

    def _once(self, what: str, name: str, work_out: Callable[[str], Values]) -> Values:
        if (what, name) not in self._known:
            self._known[what, name] = work_out(name)
        return self._known[what, name]


@dataclass(frozen=True, kw_only=True)
class PseudoInput:
    """A transformation of channels.

    Attributes
    ----------
    name, unit : str
    needs : tuple of str
        Channels, or other pseudo inputs.
    formula : str
        Its formula, with a prime for d/dt.
    meaning : str
        Where it comes from.
    reproduces : str or None
        The sensor that it predicts, except for lags and gains.

    Examples
    --------
    >>> import gtmbench as gb
    >>> yaw = gb.PSEUDO_INPUTS["r_att"]
    >>> yaw.formula, yaw.unit, yaw.reproduces
    ("psi' cos theta cos phi - theta' sin phi", 'deg/s', 'r')
    """

    name: str
    unit: str
    needs: tuple[str, ...]
    formula: str
    meaning: str
    compute: Callable[[Motion], Values] = field(repr=False)
    reproduces: str | None = None


def _p_att(x: Motion) -> Values:
    return x.slope("phi") - x.slope("psi") * x.sin("theta")


def _q_att(x: Motion) -> Values:
    return x.slope("theta") * x.cos("phi") + x.slope("psi") * x.cos("theta") * x.sin("phi")


def _r_att(x: Motion) -> Values:
    return x.slope("psi") * x.cos("theta") * x.cos("phi") - x.slope("theta") * x.sin("phi")


def _r_lat(x: Motion) -> Values:
    forward = _moving(x("tas") * x.cos("alpha") * x.cos("beta"))
    return G_M_S2 * (x.sin("phi") * x.cos("theta") + x("ny")) / forward + x.slope("phi") * np.tan(x("alpha"))


def _along(x: Motion) -> Values:
    """Return specific force and gravity along the velocity's direction in the plane of symmetry, in m/s2."""
    return _forward(x) * x.cos("alpha") + _down(x) * x.sin("alpha")


def _forward(x: Motion) -> Values:
    return G_M_S2 * (x("nx") - x.sin("theta"))


def _down(x: Motion) -> Values:
    return G_M_S2 * (x.cos("theta") * x.cos("phi") - x("nz"))


def _q_air(x: Motion) -> Values:
    across = _down(x) * x.cos("alpha") - _forward(x) * x.sin("alpha")
    sideways = np.tan(x("beta")) * (x("p") * x.cos("alpha") + x("r") * x.sin("alpha"))
    return x.slope("alpha") + sideways - across / (_moving(x("tas")) * x.cos("beta"))


def _r_air(x: Motion) -> Values:
    right = G_M_S2 * (x("ny") + x.cos("theta") * x.sin("phi"))
    across = right * x.cos("beta") - _along(x) * x.sin("beta")
    return (x("p") * x.sin("alpha") + across / _moving(x("tas")) - x.slope("beta")) / x.cos("alpha")


def _moving(speed: Values) -> Values:
    return np.where(np.abs(speed) > 1.0, speed, np.nan)  # m/s: standing still, it says nothing


def _q_from(yaw: str) -> Callable[[Motion], Values]:
    return lambda x: (x.slope("theta") + x(yaw) * x.sin("phi")) / x.cos("phi")


def _p_from(yaw: str) -> Callable[[Motion], Values]:
    def compute(x: Motion) -> Values:
        pitch = _q_from(yaw)(x)
        return x.slope("phi") - np.tan(x("theta")) * (pitch * x.sin("phi") + x(yaw) * x.cos("phi"))

    return compute


def _slope_of(channel: str) -> PseudoInput:
    return PseudoInput(
        name=f"{channel}_rate",
        unit="deg/s",
        needs=(channel,),
        formula=f"{channel}'",
        meaning="central difference",
        compute=lambda x: x.slope(channel),
    )


def _rate(name: str, needs: str, formula: str, meaning: str, compute: Callable[[Motion], Values]) -> PseudoInput:
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
_WIND = "turning of the velocity through the air, by specific force and gravity (fx, fy, fz forward, right, down)"
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
        _rate(
            "q_air",
            "p r alpha beta phi theta nx nz tas",
            "alpha' + tan beta (p cos alpha + r sin alpha) - (fz cos alpha - fx sin alpha) / (tas cos beta)",
            _WIND,
            _q_air,
        ),
        _rate(
            "r_air",
            "p alpha beta phi theta nx ny nz tas",
            "(p sin alpha - beta' + (fy cos beta - (fx cos alpha + fz sin alpha) sin beta) / tas) / cos alpha",
            _WIND,
            _r_air,
        ),
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
        Names of `PSEUDO_INPUTS`; intermediate ones are computed but not added. Existing channels are unchanged.

    Raises
    ------
    InputError
        If a name is unknown, or channels are missing; the message lists what can be built.

    Examples
    --------
    >>> import gtmbench as gb
    >>> record = gb.Record([[0.0, 0.0], [0.3, 0.0], [0.6, 0.0]], channels=["phi", "theta"], sample_period_s=0.1)
    >>> gb.derive(record, ["phi_rate"])["phi_rate"]
    array([nan,  3., nan])
    """
    check_record(record)
    new = [name for name in names("pseudo inputs", wanted) if name not in record]
    if not new:
        return record
    return with_columns(record, new, [column[:, np.newaxis] for column in derived(record, new)])


def sensitivities(record: Record, wanted: Sequence[str], channel: str) -> FloatArray:
    """Return pseudo inputs' derivatives with respect to a channel's value and to its slope (per second), row by row.

    Shape (pseudo inputs, 2, rows).

    >>> record = Record(np.zeros((3, 2)), channels=["phi", "theta"], sample_period_s=0.1)
    >>> sensitivities(record, ["phi_rate"], "phi").round(6).tolist()
    [[[nan, 0.0, nan], [nan, 1.0, nan]]]
    """
    for name in wanted:
        check_derivable(name, record.channels)
    still = _motion(record, slice(None), record.channels)
    at_rest = np.array([still(name) for name in wanted])
    found = np.empty((len(wanted), 2, len(record)))
    for place, (value, slope) in enumerate(((_STEP, 0.0), (0.0, _STEP))):
        moved = still.moved(channel, value, slope)
        for row, name in enumerate(wanted):
            per_radian = factor_of(channel) / factor_of(name)
            found[row, place] = (moved(name) - at_rest[row]) / _STEP * per_radian
    return found


def derived(record: Record, wanted: Sequence[str], among: Iterable[str] | None = None) -> list[FloatArray]:
    """Return channels and pseudo inputs as `derive` adds them, without copying a record."""
    measured = set(record.channels) if among is None else set(record.channels).intersection(among)
    for name in wanted:
        if name not in measured:
            check_derivable(name, measured)
    columns = {name: np.empty(len(record)) for name in wanted if name not in measured}
    for start in range(0, len(record) if columns else 0, _BLOCK):
        rows = slice(start, start + _BLOCK)
        before = min(start, 1)  # a derivative needs the rows beside a row
        motion = _motion(record, slice(start - before, rows.stop + 1), measured)
        for name, column in columns.items():
            column[rows] = np.rad2deg(motion(name))[before:][:_BLOCK]
    return [columns[name] if name in columns else record[name] for name in wanted]


def derivable(channels: Iterable[str]) -> tuple[str, ...]:
    """Return the pseudo inputs that can be built from some channels.

    Parameters
    ----------
    channels : iterable of str
        The measured channels.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.derivable(["phi", "theta", "psi"])[:3]
    ('p_att', 'q_att', 'r_att')
    """
    return tuple(name for name in PSEUDO_INPUTS if raw_needs(name) <= set(channels))


def check_derivable(name: str, channels: Iterable[str]) -> None:
    """Refuse a pseudo input that is unknown or lacks channels, and say what can be built instead."""
    if name not in PSEUDO_INPUTS:
        known = [*PSEUDO_INPUTS, *channels]
        raise InputError(f"no channel and no pseudo input '{name}'; there are {', '.join(known)}{meant(name, known)}")
    there = set(channels)
    missing = sorted(raw_needs(name) - there)
    if missing:
        possible = ", ".join(derivable(there)) or "none"
        raise InputError(
            f"'{name}' needs {', '.join(sorted(raw_needs(name)))}, and {', '.join(missing)} isn't there; from these "
            f"channels can be built: {possible}"
        )


def reproduces(name: str, output: str) -> bool:
    """Whether a pseudo input reads as a sensor, but for lags and gains."""
    return name in PSEUDO_INPUTS and PSEUDO_INPUTS[name].reproduces == output


def kinematic(one: str, other: str) -> bool:
    """Whether two channels read the same motion, one of them a sensor and the other a pseudo input.

    >>> kinematic("p_att", "p"), kinematic("p", "p_att"), kinematic("p", "q_att")
    (True, True, False)
    """
    return reproduces(one, other) or reproduces(other, one)


@cache
def raw_needs(name: str) -> frozenset[str]:
    """Return the measured channels behind a channel or a pseudo input, through all steps.

    >>> sorted(raw_needs("q_lat"))
    ['alpha', 'beta', 'ny', 'phi', 'tas', 'theta']
    """
    if name not in PSEUDO_INPUTS:
        return frozenset({name})
    return frozenset(raw for need in PSEUDO_INPUTS[name].needs for raw in raw_needs(need))


def factor_of(name: str) -> float:
    """Return what turns a channel into radians, m/s or g, as the formulas take it."""
    unit = PSEUDO_INPUTS[name].unit if name in PSEUDO_INPUTS else unit_of(name)
    return _M_S_PER_KT if unit == "kt" else np.pi / 180.0 if "deg" in unit else 1.0


def _motion(record: Record, rows: slice, measured: Container[str]) -> Motion:
    """Return the motion of some rows; its first and last have no derivatives."""

    def channel(name: str) -> FloatArray:
        return record[name][rows] * factor_of(name)

    def slope(name: str) -> FloatArray:
        return _slope(channel(name), record.sample_period_s)

    return Motion(measured, channel, slope)


def _slope(values: FloatArray, sample_period_s: float) -> FloatArray:
    slope = np.full(len(values), np.nan)
    steps = values[2:] - values[:-2]
    turned = np.abs(steps) > np.pi  # a heading that runs from 360 deg to 0
    steps[turned] -= 2.0 * np.pi * np.rint(steps[turned] / (2.0 * np.pi))
    slope[1:-1] = steps / (2.0 * sample_period_s)
    return slope
