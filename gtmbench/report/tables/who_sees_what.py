"""Who sees what, how soon, at what price in false alarms: a campaign's scores as one short Markdown table."""

from __future__ import annotations

import numpy as np

from gtmbench.checks import listed
from gtmbench.report.tables.scores import Cell, ScoreTable, in_markdown, ordered, place_cell, range_cell
from gtmbench.study.scores.scoring import DetectorScores, Scores
from gtmbench.values.record import FloatArray

MOST_ROWS = 14
_COLUMNS = (
    *("place", "detector", "detected", "half within (s)", "95 % within (s)", "right / wrong sensor"),
    "false alarms: an hour at most",
)


def who_sees_what(scores: Scores) -> str:
    """Return the table, best first; what is missed is infinitely late, places that no test tells apart are shared.

    In brackets: with thresholds as low, and as high, as other calibrations would have set them. Of more than fourteen
    detectors the last are named below it; so are those without a score, with the reason.

    >>> from gtmbench.study.campaign.rows import table_of
    >>> from gtmbench.study.scores.scoring import scored
    >>> quiet = [{"seed": seed, "detector": "C", "armed_hours": 0.1, "false_alarms": 0} for seed in range(8)]
    >>> broken = [
    ...     {"seed": seed, "detector": "C", "fault": "jam", "channel": "p", "detected": seed > 0,
    ...      "detection_delay_s": 0.1 * seed if seed else None, "look_ahead_s": 0.05}
    ...     for seed in range(8)
    ... ]
    >>> print(who_sees_what(scored(table_of(quiet + broken).to_pandas())).splitlines()[2])
    | 1 | C | 7 of 8 | 0.50 | missed | - | 0 in 0.8 h: 4.6 |
    """
    best_first = [one for one in ordered(scores) if one.merits and one.name in scores.delays_s]
    places = {rank.detector: rank for rank in scores.ranks}
    rows = []
    for one in best_first[:MOST_ROWS]:
        place = places.get(one.name)
        first = place_cell(place.best, place.worst) if place else Cell("-")
        rows.append((first, *map(Cell, (one.name, *_cells(one, scores.delays_s[one.name])))))
    left = [one.name for one in best_first[MOST_ROWS:]]
    notes = [f"Behind these: {listed(left)}."] if left else []
    loud = [f"{one.name} ({_quiet(one)} at least)" for one in scores.detectors if not one.is_quiet]
    target = f"{scores.target_per_hour:g} false alarms an hour are refuted for"
    notes += [f"No score, since {target} {listed(loud)}."] if loud else []
    table = ScoreTable(title="", note="", columns=_COLUMNS, rows=tuple(rows))
    return "\n".join([table.markdown(), *["\n" + in_markdown(note) for note in notes]]) + "\n"


def _cells(one: DetectorScores, delays_s: FloatArray) -> tuple[str, ...]:
    found = one.merits
    assert found is not None
    naming = found.naming
    return (
        f"{found.detected.hits} of {found.detected.of}",
        _within(delays_s, 0.5)
        + (f" ({range_cell(one.luck.median_s).text})" if one.luck and found.detected.hits else ""),
        _within(delays_s, 0.95),
        f"{naming.right.hits} / {naming.wrong.hits}" if naming else "-",
        _quiet(one),
    )


def _quiet(one: DetectorScores) -> str:
    """Say how many false alarms there were, and what rate that bounds: from above, where there is a score."""
    found = one.false_alarms
    return f"{found.events} in {found.hours:.2g} h: {found.high if one.is_quiet else found.low:.2g}"


def _within(delays_s: FloatArray, share: float) -> str:
    """Return by when a share of all faults is detected, a delay that was measured."""
    delay_s = float(np.quantile(delays_s, share, method="higher"))
    return f"{delay_s:.2f}" if np.isfinite(delay_s) else "missed"
