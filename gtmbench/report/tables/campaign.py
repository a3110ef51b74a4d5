"""A campaign's results: ``results.json`` and ``trials.csv``, made of its parts, whenever and by whomever those were."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gtmbench.files.plain import dumps
from gtmbench.jobs.parts import Parts
from gtmbench.report.tables.envelope import envelope
from gtmbench.report.tables.results import false_alarm_figures
from gtmbench.report.words.campaign import campaign_verdict
from gtmbench.study.campaign.conduct import flights_of

SOME_FAILED = 3  # an exit code
_READ = [
    *("detector", "fault", "channel", "error", "false_alarms", "armed_hours"),
    *("detected", "detection_delay_s", "isolated", "named_wrong", "kind_right", "mildest"),
]


def campaign_results(parts: Parts) -> dict[str, Any]:
    """Return what a campaign found, as one JSON-ready object, with the envelope of what is printed.

    `detectors` has an object a detector, `faults` one a detector and kind of fault. Rows with an error are counted as
    failed and as nothing else. Shares are of trials, delays of what was detected; what a detector doesn't claim to
    find, or wasn't asked, is None.
    """
    rows = parts.read(_READ).to_pandas()
    rows = rows[rows["mildest"].isna()]  # searches are scored by `gtmbench campaign --report`
    flights, finished = flights_of(parts)
    by_detector = rows.groupby("detector", sort=False)
    failed = int(rows["error"].notna().sum())
    own = {
        "campaign": parts.facts["campaign"]["name"],
        "title": parts.facts["campaign"]["title"],
        "tasks": flights,
        "tasks_done": finished,
        "parts": parts.tasks,
        "rows": len(rows),
        "failed": failed,
        "detectors": [_detector(str(name), own) for name, own in by_detector],
        "faults": [
            {"detector": name, "fault": fault, **_merits(own)}
            for name, of_detector in by_detector
            for fault, own in of_detector.groupby("fault", sort=False)
        ],
        "facts": parts.facts,
    }
    why = [{"text": f"{failed} of {len(rows)} rows failed; the column error says why"}] if failed else []
    code = SOME_FAILED if failed else 0
    return envelope("campaign", campaign_verdict(own), own, exit_code=code, findings=why)


def _detector(name: str, rows: pd.DataFrame) -> dict[str, Any]:
    healthy = rows[rows["fault"].isna() & rows["error"].isna()]
    alarms, hours = int(healthy["false_alarms"].sum()), float(healthy["armed_hours"].sum())
    return {
        "name": name,
        **_merits(rows[rows["fault"].notna()]),
        "healthy_records": len(healthy),
        **false_alarm_figures(alarms, hours),
    }


def _merits(rows: pd.DataFrame) -> dict[str, Any]:
    told = rows[rows["error"].isna()]
    delays_s = told["detection_delay_s"].dropna().to_numpy()
    return {
        "trials": len(told),
        "failed": len(rows) - len(told),
        "detected": _hits(told["detected"]),
        "median_delay_s": float(np.median(delays_s)) if len(delays_s) else None,
        "worst_delay_s": float(np.max(delays_s)) if len(delays_s) else None,
        **{name: _hits(told[name]) for name in ("isolated", "named_wrong", "kind_right")},
    }


def _hits(cells: pd.Series) -> int | None:
    """Return how many are true; None where none says."""
    said = cells.dropna()
    return int(said.astype(bool).sum()) if len(said) else None


def write_campaign(parts: Parts, folder: Path) -> None:
    """Write ``results.json``, and ``trials.csv`` with every row; part by part, so that any number fits into memory."""
    from pyarrow import csv

    (folder / "results.json").write_text(dumps(campaign_results(parts), indent=2) + "\n", encoding="utf-8")
    writer = None
    for table in parts.each():
        if writer is None:
            writer = csv.CSVWriter(folder / "trials.csv", table.schema)
        writer.write_table(table)
    if writer is not None:
        writer.close()
