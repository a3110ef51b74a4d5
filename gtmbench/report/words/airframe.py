"""An airframe's history in words: a line each constant that is worth one, the worst first."""

from __future__ import annotations

from collections.abc import Sequence

from gtmbench.history.entry import Entry
from gtmbench.history.overview import Overview, overviews_of, trend_text
from gtmbench.history.spread import FEWEST
from gtmbench.report.words.timeline import wrapped
from gtmbench.report.words.units import counted

_MOST = 5  # constants that are told
HEAD = ("constant", "flights", "last", "95 %", "expected", "over flights")


def airframe_lines(name: str, flights: Sequence[Entry], width: int) -> list[str]:
    """Return what is told of an airframe: how many flights, and which constants are others or change."""
    shown = overviews_of(flights)
    told = [each for each in shown if each.trend is not None or (len(each.is_apart) and each.is_apart[-1])]
    lines = [airframe_text(name, flights, len(told))]
    lines += [f"{each.title}: {_remark(each)}" for each in told[:_MOST]]
    return [line for text in lines for line in wrapped(text, width)]


def airframe_text(name: str, flights: Sequence[Entry], told: int) -> str:
    """Say of how many flights an airframe's history is, and whether anything changes."""
    few = f"; it takes {FEWEST} before one to tell more" if len(flights) <= FEWEST else ""
    changes = f"{counted(told, 'constant')} worth a look" if told else "no constant is another than before"
    return f"{name}: {counted(len(flights), 'flight')}, {changes}{few}."


def airframe_rows(flights: Sequence[Entry]) -> list[tuple[str, ...]]:
    """Return a row each constant, as `HEAD` names the columns."""
    return [_row(each) for each in overviews_of(flights)]


def _row(each: Overview) -> tuple[str, ...]:
    last, (low, high) = each.values[-1], each.intervals[-1]
    usual = "-" if each.usual is None else f"{each.usual[0]:.3g} to {each.usual[1]:.3g}"
    return each.title, str(len(each.flights)), f"{last:.3g}", f"{low:.3g} to {high:.3g}", usual, _remark(each)


def _remark(each: Overview) -> str:
    apart = "the last flight is another than before" if len(each.is_apart) and each.is_apart[-1] else ""
    return "; ".join(filter(None, [apart, "" if each.trend is None else trend_text(each.trend)])) or "as before"
