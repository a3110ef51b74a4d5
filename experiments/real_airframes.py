"""Real airframes: constants of gyros over the logs of a folder, each flight judged beside those before it.

    python experiments/real_airframes.py FOLDER ... [--most N] [--quick] [--jobs N] [--out DIR]

Each folder holds the logs of one airframe; they are taken in the order of their names, 9 before 10. A log counts that
opens, has gyros with an attitude, and moves for half a minute. Prints, for each airframe, its constants over flights
(the median, how far flights differ, the first and the last), and each flight that parts from those before it, with what
explains it; writes constants.csv into DIR. Nothing of the logs themselves is kept. There is no target: who looks at the
constants has to say whether they are an airframe's.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gtmbench.errors import GtmbenchError, InputError
from gtmbench.history.entry import NOISE, Entry, constants_of
from gtmbench.history.standing import stood
from gtmbench.jobs.processes import spread
from gtmbench.log.fleet import logs_in
from gtmbench.log.opening.opened_log import opened
from gtmbench.log.opening.question import asked
from gtmbench.report.markup import markdown
from gtmbench.verdict.timeline import State
from studies.conduct import Campaign, Findings, conducted

MOVES_DEG_S, MOVES_S = 3.0, 30.0
Row = dict[str, Any]


def entry(path: Path) -> tuple[Entry, str] | str:
    """Return a flight's entry and whom the engine accuses in it; or why it tells nothing."""
    question = asked(path, "auto", healthy=(), mapping=(), rate_hz=None, false_alarms_per_hour=None, attitude="auto")
    try:
        log = opened(question)
    except GtmbenchError as error:
        return str(error).removeprefix(f"{path}: ")[:60]
    if log.judged is None:
        return "no gyros with an attitude"
    flight = log.judged.flight
    moving_s = flight.blocks.period_s * int((flight.lively[flight.judged] > MOVES_DEG_S).sum())
    if moving_s < MOVES_S:
        return f"it moves for {moving_s:.0f} s"
    own = Entry(
        digest=path.name,
        log=path.name,
        airframe=path.parent.name,
        hardware=log.hardware,
        temperature_c=log.temperature_c,
        constants=constants_of(log.judged),
    )
    return own, " ".join(dict.fromkeys(name for name, _ in log.judged.accused))


def judged(name: str, told: Sequence[tuple[Entry, str]]) -> tuple[list[str], list[Row]]:
    """Return an airframe's tables, and its constants as rows."""
    known: list[Entry] = []
    apart: list[Row] = []
    accused = 0
    for own, engine in told:
        standing = stood(known, own)
        claims = standing.claims((0.0, 1.0))
        named = [sensor for sensor, span in claims if span.state in (State.FAILED, State.SUSPECTED)]
        accused += bool(named)
        if standing.apart or engine:
            first = standing.explained[0] if standing.explained else None
            apart.append(
                {
                    "log": own.log,
                    "flights before": standing.flights,
                    "parts": ", ".join(" ".join(key) for key in standing.apart[:4]),
                    "accused": " ".join(named),
                    "likeliest": "" if first is None else f"{first.explanation.kind} ({first.probability:.2f})",
                    "by the engine alone": engine,
                }
            )
        known.append(standing.entered(engine.split()))
    rows = [
        {"airframe": name, "flight": number, "log": own.log, "temperature_c": own.temperature_c}
        | {"sensor": each.sensor, "constant": each.name, "value": each.value, "deviation": each.deviation}
        for number, (own, _) in enumerate(told, 1)
        for each in own.constants
    ]
    table = pd.DataFrame(rows)
    table["value"] = np.where(table["constant"] == NOISE, np.exp(table["value"]), table["value"])
    over = table.groupby(["sensor", "constant"])["value"].agg(["size", "median", "std", "min", "max", "first", "last"])
    temperatures = [own.temperature_c for own, _ in told if np.isfinite(own.temperature_c)]
    warm = f"{min(temperatures):.0f} to {max(temperatures):.0f} deg C" if temperatures else "no temperature logged"
    text = [
        f"## {name}: {len(told)} flights, {warm}; accused beside their history: {accused}",
        markdown(over.round(3).reset_index()),
        markdown(pd.DataFrame(apart)) if apart else "Each flight is as those before it.",
    ]
    return text, rows


def conduct(campaign: Campaign) -> Findings:
    """Open, judge, report."""
    given = campaign.given
    wrong = [str(folder) for folder in given.folders if not folder.is_dir()]
    if wrong:
        raise InputError(f"{', '.join(wrong)} is no folder; give one an airframe")
    most = 3 if campaign.quick else given.most
    text, rows = ["# Real airframes", str(__doc__).partition("\n\n")[2]], []
    for folder in given.folders:
        paths = logs_in([folder])[:most]
        done = spread(entry, paths, processes=campaign.jobs, step=folder.name, progress=campaign.tell)
        told = [each for each in done if not isinstance(each, str)]
        left = pd.Series([each for each in done if isinstance(each, str)], dtype=str).value_counts()
        if told:
            own, its_rows = judged(folder.name, told)
            text, rows = [*text, *own], [*rows, *its_rows]
        text.append(f"Left out of {folder.name}: {left.head(5).to_dict() or 'none'}.")

    def write(out: Path) -> None:
        pd.DataFrame(rows).to_csv(out / "constants.csv", index=False)

    return Findings("\n\n".join(text) + "\n", False, write)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is judged."""
    parser.add_argument("folders", nargs="+", type=Path, help="folders of logs, one an airframe")
    parser.add_argument("--most", type=int, default=40, help="logs of a folder (default: %(default)s)")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="three logs a folder", arguments=arguments))
