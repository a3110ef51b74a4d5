"""Column names that are known, and the units that stand in them: what a header says, and what it leaves open."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from gtmbench.intake.formats.dialects import NAMES
from gtmbench.intake.formats.raw import Meaning, RawSeries
from gtmbench.intake.units import dimension_of, hint, unit
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, CHANNEL_OF_HEADER, GYROS

_KNOWN = {  # by name the channel, and -1 where its axis points away
    name.lstrip("-"): (channel, -1.0 if name.startswith("-") else 1.0)
    for channel, names in NAMES.items()
    for name in names.split()
}
_STATED = {"ktas": "kt", "seconds": "s"}  # names that are units
_OPEN = {
    "airspeed": ("tas", "may be indicated or true"),
    "ias": ("tas", "is indicated, not true"),
    "cas": ("tas", "is calibrated, not true"),
    "course": ("psi", "is the way over ground, not the heading"),
    "track": ("psi", "is the way over ground, not the heading"),
    "v": ("tas", "may be the true airspeed or a velocity's part"),
} | {
    f"{kind}{axis}": (channel, "may be in axes that point left and up (ROS) or right and down")
    for kind, channels in (("angularvelocity", GYROS), ("linearacceleration", ACCELEROMETERS))
    for axis, channel in zip("xyz", channels, strict=True)
}
_OPEN |= {
    f"orientation{angle}": (channel, "may be of axes that point left and up (ROS) or right and down")
    for angle, channel in (("roll", "phi"), ("pitch", "theta"), ("yaw", "psi"))
}
_NOT_MEASURED = re.compile(
    r"(?i)(^|[^a-z])(des|desired|sp|setpoint|cmd|command|target|ref|err|error|cov|std|var|bias|b_[agw]_|pid|[nx]k[a-z]\d)"
)
_BRACKETS = re.compile(r"^(?P<base>.*?)[\s_,]*[\[({<]\s*(?P<unit>[^\[\](){}<>]*[A-Za-z%°µμ][^\[\](){}<>]*)[\])}>]\s*$")


@dataclass(frozen=True, kw_only=True)
class NameGuess:
    """What a column's name says."""

    channel: str = ""  # which channel it looks like, ``time`` for the time, "" for none
    meaning: Meaning | None = None  # what it is, where name and unit say so without doubt
    why_not: str = ""  # what is left open, where something is


def stated_unit(header: str, unit_beside: str = "") -> tuple[str, str]:
    """Return a header's name and the unit that it states, "" for none.

    >>> stated_unit("p [rad/s]"), stated_unit("ax_m_s2"), stated_unit("gyro_x")
    (('p', 'rad/s'), ('ax', 'm_s2'), ('gyro_x', ''))
    """
    if unit_beside:
        return header, unit_beside
    bracketed = _BRACKETS.match(header)
    if bracketed and bracketed["base"]:
        words, _, last = bracketed["unit"].strip().rpartition(" ")
        if words and unit(bracketed["unit"]) is None and unit(last) is not None:  # ORIENTATION X (pitch °)
            return f"{bracketed['base']} {words}", last
        return bracketed["base"], bracketed["unit"].strip()
    # TimeUS and RollDeg are written without a line between
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", header)
    for place in (match.start() for match in re.finditer(r"[\s_,-]+", spaced)):
        if place and unit(spaced[place:].strip(" _,-")):
            return spaced[:place], spaced[place:].strip(" _,-")
    return header, ""


def guess(header: str, unit_beside: str = "") -> NameGuess:
    """Return what a column is by its name and unit.

    >>> guess("gyro_x (deg/s)").meaning
    Meaning(channel='p', unit='deg/s', sign=1.0, late_s=0.0, guessed='')
    >>> guess("gyro_x").why_not
    'looks like p, but states no unit: --map p=gyro_x:rad/s or :deg/s'
    >>> guess("p [hPa]").why_not
    "looks like p, but states 'hPa', not a unit of angular rate that is known: --map 'p=p [hPa]:rad/s' or :deg/s"
    """
    base, stated = stated_unit(header, unit_beside)
    parts = re.split(r"[./:]", base)
    field = parts[-1]
    if _NOT_MEASURED.search(base):
        return NameGuess()
    for key in (_key(base), _key("".join(parts[-2:])), _key(field)):
        if key in _KNOWN:
            channel, sign = _KNOWN[key]
            return _judged(header, channel, stated or _STATED.get(key, ""), sign)
        if key == "v" and field == "V" and (speed := unit(stated)) and speed.dimension == "speed":
            return _judged(header, "tas", stated, 1.0)
        if key in _OPEN:
            channel, why = _OPEN[key]
            return NameGuess(channel=channel, why_not=f"{why}: {unit_option(channel, header)} if it is {channel}")
    return NameGuess()


def known_as(name: str) -> str:
    """Return the channel that goes by a name, ``time`` for the time; "" for none.

    >>> known_as("roll_rate"), known_as("P"), known_as("flaps")
    ('p', 'p', '')
    """
    return _KNOWN.get(_key(name), ("", 0.0))[0]


def _judged(header: str, channel: str, stated: str, sign: float) -> NameGuess:
    known = unit(stated) if stated else None
    if known is not None and known.dimension == dimension_of(channel):
        return NameGuess(channel=channel, meaning=Meaning(channel=channel, unit=stated, sign=sign))
    if known is not None and channel == "time":
        return NameGuess()  # T in degrees is a temperature
    said = f"states '{stated}', not a unit of {dimension_of(channel)} that is known" if stated else "states no unit"
    return NameGuess(channel=channel, why_not=f"looks like {channel}, but {said}: {unit_option(channel, header)}")


def unit_option(channel: str, header: str) -> str:
    """Return how a mapping would state a column's unit, as it is typed."""
    first, second = hint(channel)
    option = shlex.quote(f"{channel}={header}:{first}")
    return f"--map {option} or :{second}"


def _key(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def is_table_header(name: str) -> bool:
    """Tell whether a column is named exactly as this package names it: ``p_deg_s``."""
    return name == "time_s" or name in CHANNEL_OF_HEADER


@dataclass(frozen=True, kw_only=True, eq=False)
class Triple:
    """Three columns that are named as the axes of one sensor: rates, angles or accelerations."""

    kind: str  # ``rate``, ``angle``, ``acceleration``
    series: tuple[RawSeries, ...]  # about, or along, x, y and z; of an attitude without a heading two
    meanings: tuple[Meaning, ...] = ()  # what they are, where that is settled
    is_exact: bool = True  # whether all three names are known as they are, not by parts
    is_reordered: bool = False  # whether they stand in another order than their names say
    handed: float = 1.0  # -1 where that order makes left-handed axes of right-handed ones

    @property
    def clock(self) -> str:
        """Whose stamps they have."""
        return self.series[0].clock

    @property
    def stated(self) -> str:
        """The unit that all three state, "" for none."""
        units = {meaning.unit for meaning in self.meanings} or {
            stated_unit(series.name, series.unit)[1] for series in self.series
        }
        only = units.pop() if len(units) == 1 else ""
        known = unit(only)
        return only if known is not None and known.dimension == _DIMENSIONS[self.kind] else ""

    @property
    def signs(self) -> tuple[float, ...]:
        """Their signs, where they are settled; else none."""
        return tuple(meaning.sign for meaning in self.meanings)


_DIMENSIONS = {"rate": "angular rate", "angle": "angle", "acceleration": "acceleration"}
_AXES = ("roll|phi|bank", "pitch|theta", "yaw|psi|heading|hdg|azimuth")
_AXIS = re.compile(rf"(?P<word>{'|'.join(_AXES)})|(?P<letter>[xyzpqr])$|\[(?P<place>[012])\]$")
_RATES = re.compile(r"gyr|omega|pqr|rate|rot|ang[a-z]*_?vel|\*_?(speed|dot|vel|d)$|(^|[^a-z])(w|av)(_|$|\*)|^\*$")
_ANGLES = re.compile(r"(^|[^a-z])(att|euler|rpy|angle|ori|eul)")
_ACCELERATIONS = re.compile(r"acc|specific_?force|(^|[^a-z])(a|f)_?b?_?\*$")
_QUATERNION = re.compile(r"quat|orientation|(^|[^a-z])q[a-z_]*\*$")
_NO_SENSOR = re.compile(r"mag|grav|offset|trim|gain|pid|stick|rc_|ctrl|demand|innov|delta|noise|temp|angular_?acc")


def triples(series: Sequence[RawSeries]) -> list[Triple]:
    """Return the columns of a log that are named as three axes of one sensor, by any of the words in use."""
    found: dict[tuple[str, str, str], dict[int, RawSeries]] = {}
    for each in series:
        named = _as_axis(each)
        if named is not None:
            kind, axis, stem = named
            found.setdefault((each.clock, kind, stem), {})[axis] = each
    made = []
    for (_, kind, _), axes in found.items():
        if len(axes) == 3:
            own = (axes[0], axes[1], axes[2])
            documented = tuple(each.meaning for each in own if each.meaning is not None)
            is_exact = all(guess(each.name, each.unit).channel not in ("", "time") for each in own)
            meanings = documented if len(documented) == 3 else ()
            made.append(Triple(kind=kind, series=own, meanings=meanings, is_exact=is_exact))
    known = {each.series for each in made}
    return [*made, *(each for each in _by_channels(series) if each.series not in known)]


def _by_channels(series: Sequence[RawSeries]) -> list[Triple]:
    """Return gyros and attitudes whose names are channels', as gx, gy and gz; an attitude may lack its heading."""
    named: dict[tuple[str, str], list[RawSeries]] = {}
    for each in series:
        if each.meaning is None and (channel := guess(each.name, each.unit).channel):
            named.setdefault((each.clock, channel), []).append(each)
    only = {key: columns[0] for key, columns in named.items() if len(columns) == 1}
    made: list[Triple] = []
    for clock in dict.fromkeys(clock for clock, _ in only):
        for kind, channels in (("rate", GYROS), ("angle", ATTITUDE), ("angle", ATTITUDE[:2])):
            axes = tuple(only[clock, channel] for channel in channels if (clock, channel) in only)
            if len(axes) == len(channels) and not any(set(axes) <= set(each.series) for each in made):
                made.append(Triple(kind=kind, series=axes))
    return made


def unnamed_rates(series: Sequence[RawSeries]) -> list[Triple]:
    """Return three columns beside each other that state a unit of angular rate, whatever they are called.

    >>> names = ("T [s]", "PRGX [deg/s]", "QRGY [deg/s]", "RRGZ [deg/s]")
    >>> (triple,) = unnamed_rates([RawSeries(name=name, load=list) for name in names])
    >>> [column.name for column in triple.series]
    ['PRGX [deg/s]', 'QRGY [deg/s]', 'RRGZ [deg/s]']
    """
    runs = groupby(series, key=lambda each: (each.clock, _states_rate(each)))
    together = [tuple(columns) for (_, is_rate), columns in runs if is_rate]
    return [Triple(kind="rate", series=columns, is_exact=False) for columns in together if len(columns) == 3]


def _states_rate(series: RawSeries) -> bool:
    known = unit(stated_unit(series.name, series.unit)[1])
    return known is not None and known.dimension == _DIMENSIONS["rate"] and not _NOT_MEASURED.search(series.name)


def _as_axis(series: RawSeries) -> tuple[str, int, str] | None:
    """Return which kind of sensor a column's name means, which axis, and the name without that; None of others.

    >>> _as_axis(RawSeries(name="imu.bodyRate_y", load=list)), _as_axis(RawSeries(name="EulerAngles[2]", load=list))
    (('rate', 1, 'imu.body_rate_*'), ('angle', 2, 'euler_angles*'))
    """
    base = stated_unit(series.name, series.unit)[0]
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", base).lower().strip()
    axis = _AXIS.search(name)
    if axis is None or name in "xyz" or _NOT_MEASURED.search(name) or _NO_SENSOR.search(name):
        return None
    if axis["word"]:
        place = next(i for i, words in enumerate(_AXES) if re.fullmatch(words, axis["word"]))
    else:
        place = int(axis["place"]) if axis["place"] else "xyzpqr".index(axis["letter"]) % 3
    stem = name[: axis.start()] + "*" + name[axis.end() :]
    stem = re.sub(r"(?<=[\s_])[xyz][\s_]+(?=\*)", "", stem) if axis["word"] else stem
    if axis["letter"] and _QUATERNION.search(stem):
        return None
    if _ACCELERATIONS.search(stem):
        return ("acceleration", place, stem) if not axis["word"] else None
    if _RATES.search(stem) and not (axis["word"] and stem == "*"):
        return "rate", place, stem
    if axis["word"] or _ANGLES.search(stem):
        return "angle", place, stem
    return None
