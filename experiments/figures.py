"""Fill the figures of README and docs in from `results.json`: what a page says of a run is written by nobody.

Run ``python experiments/figures.py``, or ``make figures``. A figure stands between ``<!-- figures: NAME -->`` and
``<!-- end -->``; `FIGURES` has what is written there, and ``table REPORT N`` is the Nth table of a report with the line
that says of which run it is. What rests on several results needs them all from one version of the code: another digest
among them is an error.
"""

from __future__ import annotations

import json
import math
import re
import statistics
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click

from dissertation.reproduction import tally
from gtmbench.checks import listed
from gtmbench.errors import InputError
from gtmbench.study.scores.intervals import exact_interval
from studies.tables import tables_in

HERE = Path(__file__).parent
MARKED = re.compile(r"(?P<begin><!-- figures: (?P<name>[\w ]+) -->).*?(?P<end><!-- end -->)", re.DOTALL)
COLUMNS = {  # of wide tables, what pages show
    ("which_gyro", 1): (
        "detector",
        "detected",
        "median (s)",
        "95 % (s)",
        "right sensor",
        "wrong sensor",
        "false alarms an hour",
    ),
    ("every_fault_again", 1): ("sensors", "detected", "median (s)", "right", "wrong", "kind"),
    ("chain_rescue", 1): ("part", "remedy", "flights", "departed", "broken sensor replaced", "healthy sensor replaced"),
}
OF_FLIGHTS = {("chain_rescue", 1): "departed"}  # counts of flights, which are shown with an interval
BESIDE = ("C", "C-early", "B", "dissertation")  # the rivals
WAYS = {
    "estimated": "one more unknown of each output, one for all records (the default)",
    "records": "what the records' means give, over all of their samples",
    "none": "0, as printed",
}


def results(name: str) -> dict[str, Any]:
    """Return what a script left when it was run last."""
    read: dict[str, Any] = json.loads((HERE / "reports" / name / "results.json").read_text(encoding="utf-8"))
    return read


def rows_of(name: str, column: str) -> list[dict[str, str]]:
    """Return the rows of a report's first table that has such a column."""
    return next(rows for rows in tables_of(name) if rows and column in rows[0])


def tables_of(name: str) -> list[list[dict[str, str]]]:
    """Return the tables of a report, of its results or, where `gtmbench benchmark` wrote it, of its text."""
    folder = HERE / "reports" / name
    if (folder / "results.json").exists() and "tables" in results(name):
        return list(results(name)["tables"])
    return tables_in((folder / "report.md").read_text(encoding="utf-8"))


def shown(report: str, number: int) -> str:
    """Return a table of a report, with the columns that pages show, and below it of which run it is."""
    rows = tables_of(report)[number - 1]
    columns = COLUMNS.get((report, number), tuple(rows[0]))
    if count := OF_FLIGHTS.get((report, number)):
        rows = [row | {count: with_interval(row[count], row["flights"])} for row in rows]
    lines = [columns, ["---"] * len(columns), *([row[column] for column in columns] for row in rows)]
    table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    return f"\n{table}\n\n{of_run(report)}\n"


def with_interval(hits: str, of: str) -> str:
    """Write a count of flights with the 95 % interval of its share.

    >>> with_interval("107", "120")
    '107 (82 to 94 %)'
    """
    low, high = exact_interval(int(hits), int(of))
    return f"{hits} ({100 * low:.0f} to {100 * high:.0f} %)"


def of_run(report: str) -> str:
    """Say which code made a report, or that it is older than the digests.

    >>> of_run("lost_samples").startswith("*`experiments/reports/lost_samples`, by code ")
    True
    """
    read = results(report)
    digest = read["code"].get("source")
    made = f"by code {digest[:8]}" if digest else f"of {read['date']}, by older code: not run since"
    return f"*`experiments/reports/{report}`, {made}.*"


def values(name: str, result: str) -> Any:
    """Return the values of the row whose name begins so."""
    (row,) = [row for row in results(name)["rows"] if row["result"].startswith(result)]
    return row["values"]


def of_one_code(names: list[str]) -> list[dict[str, Any]]:
    """Return the results of several scripts, which the same code must have made."""
    read = [results(name) for name in names]
    made = {each["code"]["source"] for each in read}
    if len(made) > 1:
        raise InputError(f"results of {len(made)} versions of the code: {', '.join(names)}; run all of them anew")
    return read


def agreement() -> str:
    """Say how many rows of the dissertation's table agree."""
    names = [path.parent.name for path in sorted(HERE.glob("reports/*/results.json"))]
    parts = [name for name in names if "rows" in results(name)]
    return tally(row["agreement"] for each in of_one_code(parts) for row in each["rows"])


def constants() -> str:
    """Return the table of what a constant does to the operator of section 4.4."""
    found = values("aircraft_gyros", "(4.9), residual by its constant")
    lines = [
        f'| `"{way}"` | {what} | {found["residual"][way]:.4f} deg/s | {found["Fig. 4.2"][way]:.3f} |'
        for way, what in WAYS.items()
    ]
    head = "| `constant` | the constant is | RMS of the one-step residual | Fig. 4.2, error of the prediction over r |"
    return "\n".join(["", head, "|---|---|---|---|", *lines, ""])


def other_excitation() -> str:
    """Say how large the residual is on the flight that was learnt and on another."""
    own, other = values("aircraft_gyros", "4.4, residual on its own and another flight")
    return f"{own:.2f} deg/s on that flight and {other:.1f} deg/s"


class MainJob(NamedTuple):
    """What one detector made of the fifteen faults; delays in words, over all of them."""

    detected: str
    delay: str
    isolated: int
    wrong: int
    isolation: str
    false_alarms: str


def main_job(detector: str) -> MainJob:
    """Return the figures of a detector on the main job."""
    read = results("main_job")
    trials = [trial for trial in read["trials"] if trial["detector"] == detector]
    (healthy,) = [each for each in read["healthy"] if each["detector"] == detector]
    return MainJob(
        detected=f"{sum(trial['detected'] for trial in trials)} of {len(trials)}",
        delay=median_of_all([trial["detection_delay_s"] for trial in trials]),
        isolated=sum(bool(trial["isolated"]) for trial in trials),
        wrong=sum(bool(trial["named_wrong"]) for trial in trials),
        isolation=median_of_all([trial["isolation_delay_s"] for trial in trials]),
        false_alarms=f"{healthy['false_alarms']} in {healthy['hours']:.2f} h",
    )


def median_of_all(delays_s: Sequence[float | None]) -> str:
    """Return the median over all faults: one that was missed comes never, later than any that was found.

    >>> median_of_all([1.0, None, 3.0]), median_of_all([1.0, None, None])
    ('3.0 s', 'never')
    """
    median = statistics.median_low(math.inf if delay is None else delay for delay in delays_s)
    return "never" if math.isinf(median) else f"{median:.1f} s"


def main_job_table() -> str:
    """Return README's table of two detectors."""
    bank, operator = main_job("C"), main_job("dissertation")
    wrong = f"{bank.wrong} wrong" if bank.wrong else "none wrong"
    lines = [
        "| detector | predicts | detected | median detection delay | isolated | median time to isolation "
        "| false alarms |",
        "|---|---|---:|---:|---:|---:|---:|",
        f"| `C`, a bank of three operators | each gyro from the attitude | {bank.detected} | {bank.delay} | "
        f"{bank.isolated}, {wrong} | {bank.isolation} | {bank.false_alarms} |",
        f"| `dissertation`, one operator | yaw gyro from the other two and sideslip | {operator.detected} | "
        f"{operator.delay} | can't | | {operator.false_alarms} |",
    ]
    return "\n".join(["", *lines, ""])


def main_job_sentence() -> str:
    """Say the same in a sentence."""
    bank, operator = main_job("C"), main_job("dissertation")
    return (
        f"bank C detects {bank.detected} and isolates the right gyro of {bank.isolated}, after {bank.delay} and "
        f"{bank.isolation} in the median over all fifteen (a missed one counts as never found); the dissertation's "
        f"operator detects {operator.detected}, after {operator.delay}, and can't isolate"
    )


def own_noise() -> str:
    """Say what the dissertation's operator finds with its own noise, over several seeds."""
    runs = results("main_job")["own noise"]
    trials = [trial for run in runs for trial in run["trials"]]

    def span(scenario: str, channel: str) -> str:
        chosen = [each for each in trials if (each["scenario"], each["channel"]) == (scenario, channel)]
        found = sorted(each["detection_delay_s"] for each in chosen if each["detected"])
        missed = len(chosen) - len(found)
        return f"{found[0]:.1f} to {found[-1]:.1f} s" + (f" ({missed} of {len(chosen)} missed)" if missed else "")

    rest = [each["detection_delay_s"] for each in trials if each["scenario"] != "drift" and each["detected"]]
    hours = sum(run["healthy"][0]["hours"] for run in runs)
    alarmed = sum(run["healthy"][0]["false_alarms"] > 0 for run in runs)
    return (
        f"this detects {sum(each['detected'] for each in trials)} of {len(trials)} of the dissertation's faults. The "
        f"drift of the roll gyro takes {span('drift', 'p')}, of the pitch gyro {span('drift', 'q')}, of the yaw gyro "
        f"{span('drift', 'r')}; what else is found is found within {max(rest):.0f} s. In "
        f"{hours:.1f} h of healthy flight there are false alarms on {share(alarmed, len(runs))}"
    )


def healthy_bound() -> str:
    """Say what no false alarm bounds."""
    hours = min(each["hours"] for each in results("main_job")["healthy"])
    return f"No false alarm in {hours:.2f} h bounds the rate at {-math.log(0.05) / hours:.1f} an hour (95 % confidence)"


def share(hits: int, of: int) -> str:
    """Write a share of flights with its interval.

    >>> share(107, 120)
    '107 of 120 flights (82 to 94 % at 95 % confidence)'
    """
    low, high = exact_interval(hits, of)
    return f"{hits} of {of} flights ({100 * low:.0f} to {100 * high:.0f} % at 95 % confidence)"


def rescue() -> str:
    """Say how many flights depart with a gyro that fails hard, unaided and accommodated."""
    (unaided, aided) = (
        share(int(row["departed"]), int(row["flights"]))
        for remedy in ("unaided", "accommodated")
        for row in rows_of("chain_rescue", "remedy")
        if (row["part"], row["remedy"]) == ("hard gyro faults", remedy)
    )
    return f"{unaided} depart, with the monitor {aided}"


def benchmark() -> str:
    """Say how quick some entries are, and how many faults they name wrong."""
    entries = {row["entry"]: row for row in rows_of("gtmbench-2", "quickness")}
    told = {
        "C-early": "`C-early`",
        "C": "`C`",
        "kinematic-kalman": "a kinematic Kalman filter with its FIR part",
        "windowed-glr": "a page of numpy",
        "limits": "limit checks",
    }
    quick = ", ".join(f"{words} {entries[name]['quickness']}" for name, words in told.items())
    wrong = [entries[name]["named right / wrong / either-or"].split(" / ")[1] for name in told]
    flights = entries["C"]["missed"].rpartition(" of ")[2]
    return (
        f"quickness on the quick set (1: a reference that knows all but the onset): {quick}. Of {flights} flights with "
        f"a fault named wrong: {', '.join(wrong)}"
    )


def rivals_table() -> str:
    """Return the comparison of all detectors, and who has no score, as the campaign's report has them."""
    read = results("rivals")
    names = list(read["table"][0])
    lines = [names, ["---"] * len(names), *(list(row.values()) for row in read["table"])]
    table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    return "\n".join(["", table, *(f"\n{note}" for note in read["notes"]), ""])


def rivals_again() -> str:
    """Say what bank B does by the code that came after the table."""
    (row,) = results("rivals_B")["table"]
    right, wrong = row["right / wrong sensor"].split(" / ")
    return (
        f"alone, on the same flights, it detects {row['detected']}, names {right} right and {wrong} wrong. "
        f"{of_run('rivals_B')}"
    )


def rivals_sentence() -> str:
    """Say who shares the first place, and how the other detectors of the literature come out."""
    read = results("rivals")
    scored = {row["detector"]: row for row in read["table"]}
    first = [name for name, row in scored.items() if row["place"].split("-")[0] == "1"]
    behind = [row["detected"].split(" of ") for name, row in scored.items() if name not in (*first, *BESIDE)]
    most = max(int(found) for found, _ in behind)
    return (
        f"{listed([f'`{name}`' for name in first])} {'share' if len(first) > 1 else 'has'} the first place; of the "
        f"other detectors of the literature {len(behind)} keep the rate of false alarms that they were calibrated for, "
        f"as far as can be told, and detect at most {most} of {behind[0][1]} faults, and the rest raise more"
    )


def total(rows: list[dict[str, str]], column: str) -> int:
    """Return the sum of a column of counts."""
    return round(sum(float(row[column]) for row in rows))


def several_imus() -> str:
    """Say what comes of a gyro that fails in one of several IMUs, and that the run is of today's code or not."""
    rows = rows_of("several_imus", "IMUs")
    put, named, either, wrong, silent = (
        total(rows, column) for column in ("faults", "named", "either-or", "named wrong", "not accused")
    )
    return (
        f"Of {put} faults on synthetic flights, whose estimator the broken IMU drives or another, {named} are named, "
        f"{either} either-or, {silent} accuse nobody and {wrong} name a healthy gyro. {of_run('several_imus')}"
    )


def other_sensors() -> str:
    """Say which of the faults of sensors that no gyro enters are found in logs."""
    rows = rows_of("other_sensors_in_logs", "channel")
    put, named, either, late, wrong, silent, clear = (
        total(rows, column)
        for column in ("put", "named", "either-or", "late", "wrong", "not accused", "beside a clear row")
    )
    return (
        f"On flights of the GTM of four minutes in turbulence, written as logs, {named} of {put} faults (10 kt, 3 deg, "
        f"0.2 g, 100 ft, 3 m/s, 20 % of the field, or one value, noise, a blocked tube) are named within 30 s, "
        f"{either} are either-or, {late} come later, {silent} accuse nobody, {wrong} name another sensor, and {clear} "
        f"lie beside a sensor that is called clear. {of_run('other_sensors_in_logs')}"
    )


def other_aircraft() -> str:
    """Say how many of JSBSim's aircraft fly, and of how many all faults are named."""
    rows = rows_of("other_aircraft", "doublets: right")
    named = sum(row[column] == "6 of 6" for row in rows for column in ("right", "doublets: right"))
    return (
        f"{len(rows)} of JSBSim's aircraft fly five minutes under multisine and moderate turbulence, open loop or in "
        f"the loop; bank C, calibrated on three such flights, names all six drifts and jams in "
        f"{share(named, 2 * len(rows))}. "
        f"{of_run('other_aircraft')}"
    )


def every_kind() -> str:
    """Say how the monitor that ships meets every kind of fault."""
    rows = {row["sensors"]: row for row in rows_of("every_fault_again", "axis")}
    said = [
        f"{words}: {row['detected']} detected, {row['right']} of these named right, {row['wrong']} wrong"
        for words, row in (("gyros", rows["gyro"]), ("attitude", rows["attitude"]))
    ]
    return "; ".join(said)


def real_logs() -> str:
    """Say what is said of public logs, and of faults that are put on them."""
    head, *rest = (dict(row) for row in rows_of("real_logs", "unseen7"))
    figures = {row.pop(""): row for row in (head, *rest)}
    groups = [name for name in figures["logs"] if "sitl" not in name and name != "gtm"]

    def of(name: str) -> int:
        return sum(int(figures[name][group].split()[0]) for group in groups)

    last = figures["usual faults, alone: found / named / wrong"]["unseen7"]
    through = figures["usual faults, 5 s: found / named / wrong"]["unseen7"]
    logs, accused, quiet, found, open_ = map(
        of, ("logs", "healthy accused", "end with 0", "a failure found", "can't tell")
    )
    return (
        f"of {logs} logs {accused} are accused that are healthy as far as is known; {quiet} end with nothing found, "
        f"{open_} with *can't tell*, in {found} a true failure is found. Everyday faults that were put on the logs "
        f"that were watched last: found / named / wrong in {last} on a gyro alone, in {through} through an estimator"
    )


def surfaces() -> str:
    """Say how many faults of surfaces and of the throttle are named right."""
    said = []
    for what, number in (("a surface", 2), ("the throttle", 3)):
        rows = tables_of("surface_faults")[number - 1]
        moved, right, wrong = (total(rows, name) for name in ("move", "of these named right", "named wrong (of all)"))
        said.append(f"of {what} {right} of {moved} named right, {wrong} wrong")
    return f"{'; '.join(said)}. {of_run('surface_faults')}"


def heading_witness() -> str:
    """Say whose error a magnetometer between r and psi tells."""
    rows = rows_of("heading_witness", "asked")
    lies = [f"{row['size']} {row['r']} of {row['asked']}" for row in rows if row["wrong"].endswith("of r")]
    healthy = [row for row in rows if not row["wrong"].endswith("of r")]
    accused = total(healthy, "r")
    return (
        f"it named an error of r of {listed(lies)}, and accused r in {accused} of {total(healthy, 'asked')} cases in "
        f"which r was healthy"
    )


def hard_motion() -> str:
    """Say how many departures after a broken gyro name a healthy sensor, with the rule about motion and without it."""
    rows = {row["rule"]: row for row in rows_of("hard_motion", "rule") if row["part"] == "broken gyros"}
    with_rule, without = (share(int(rows[rule]["a healthy sensor named"]), int(rows[rule]["flights"])) for rule in rows)
    return f"{with_rule} name a healthy sensor, without that rule {without}. {of_run('hard_motion')}"


def next_motions() -> str:
    """Say how many sensors a motion that was named let be judged as it was promised."""
    rows = rows_of("next_motions", "attitude")
    right = round(sum(float(row["sensors"]) * float(row["right"]) for row in rows))
    return f"{right} of {total(rows, 'sensors')} sensors"


FIGURES: dict[str, Callable[[], str]] = {
    "several imus": several_imus,
    "other sensors": other_sensors,
    "other aircraft": other_aircraft,
    "next motions": next_motions,
    "hard motion": hard_motion,
    "surfaces": surfaces,
    "magnetometer": heading_witness,
    "every kind": every_kind,
    "real logs": real_logs,
    "own noise": own_noise,
    "main job": main_job_table,
    "main job in words": main_job_sentence,
    "agreement": agreement,
    "constants": constants,
    "other excitation": other_excitation,
    "healthy bound": healthy_bound,
    "rescue": rescue,
    "benchmark": benchmark,
    "rivals": rivals_table,
    "bank B again": rivals_again,
    "rivals in words": rivals_sentence,
}


def figure_of(name: str) -> str:
    """Return the text of a figure by its name."""
    match name.split():
        case ["table", report, number]:
            return shown(report, int(number))
    if name not in FIGURES:
        raise InputError(f"there are no figures '{name}'; there are {', '.join(FIGURES)}, and table REPORT N")
    return FIGURES[name]()


def filled(page: str) -> str:
    """Return a page with all of its figures as the results have them."""

    def figure(marked: re.Match[str]) -> str:
        return f"{marked['begin']}{figure_of(marked['name'])}{marked['end']}"

    return MARKED.sub(figure, page)


def pages() -> list[Path]:
    """Return README and the pages of the documentation."""
    return [HERE.parent / "README.md", *sorted((HERE.parent / "docs").rglob("*.md"))]


def main() -> int:
    """Fill all pages in, and tell which changed."""
    try:
        for path in pages():
            before = path.read_text(encoding="utf-8")
            after = filled(before)
            if after != before:
                path.write_text(after, encoding="utf-8")
                click.echo(f"{path.name}: figures changed")
    except (InputError, OSError, KeyError) as error:
        click.echo(f"figures.py: {error}", err=True)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
