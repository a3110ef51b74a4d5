"""The figures as tables: for the screen, and as the page's block."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

TARGETS = {  # figure of bench.json: (at least or at most, bound)
    ("identification", "ratio"): (">=", 100.0),
    ("identification", "memory_ratio"): (">=", 8.0),
    ("identification", "markov_rel_diff"): ("<=", 1e-9),
    ("fresh", "tenth"): (">=", 100.0),
    ("commands", "monitor_healthy"): ("<=", 6.0),
    ("residual", "ratio"): (">=", 10.0),
    ("norm", "ratio"): (">=", 10.0),
    ("flight", "ratio"): ("<=", 1.35),
    ("flight", "closed_ratio"): ("<=", 2.0),
}
ALONE_TARGETS = {  # of sections that are only measured when asked for, so they stand in no bench.json
    ("day", "ratio"): (">=", 4000.0),
    ("day", "watch_ratio"): (">=", 10000.0),
    ("day", "memory_gb"): ("<=", 1.0),
}
ROWS = (  # what is measured, section, and its keys of time, memory and difference
    ("numpy lstsq over `gb.identify`", "identification", "ratio", "memory_ratio", "markov_rel_diff"),
    ("the same, building lstsq's regressor counted", "identification", "ratio_with_regressor"),
    ("the same in a fresh process, first call, imports counted", "fresh", "with_imports"),
    ("first call, SciPy imported before", "fresh", "first"),
    ("tenth call", "fresh", "tenth"),
    ("the call after an lstsq", "fresh", "after_lstsq"),
    ("`gtmbench monitor`, two minutes with a fault, over importing numpy and pandas", "commands", "monitor_broken"),
    ("the same of a healthy log", "commands", "monitor_healthy"),
    ("`import gtmbench.api` over Python alone", "commands", "api"),
    ("`gtmbench --help` over that", "commands", "help"),
    ("copying the regressor and multiplying over `gb.residual`", "residual", "ratio", "memory_ratio", "rel_diff"),
    ("`np.correlate` per channel over `gb.residual`", "residual", "correlate_ratio", "correlate_memory_ratio"),
    ("summing `sliding_window_view` over `gb.windowed_norm`", "norm", "ratio", "memory_ratio", "rel_diff"),
    ("10 ms over a sample of bank C's stream, one a push (three gyros, 100 Hz)", "stream", "ratio"),
    ("the same, 100 a push", "stream", "chunk_ratio"),
    ("a watch of 300 s with a lasting gyro fault, diagnosed, over one of a healthy record", "diagnosis", "ratio"),
    ("a trial of that fault with names (`monitor.begun`) over that", "diagnosis", "named_ratio"),
    ("one without (`monitor.trials`) over that", "diagnosis", "trial_ratio"),
    (
        "a day of 100 Hz over the time that `gtmbench monitor` with a ready monitor takes (memory: GB)",
        "day",
        "ratio",
        "memory_gb",
    ),
    ("the same, the watch alone", "day", "watch_ratio"),
    ("the flight loop over JSBSim's bare `run()` loop", "flight", "ratio"),
    ("a flight with the autopilot in the loop over one without", "flight", "closed_ratio"),
    ("the same with a drift in the loop", "flight", "broken_ratio"),
)


@dataclass(frozen=True)
class Table:
    """A title, the columns' heads and the rows, as text."""

    title: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]

    def markdown(self) -> str:
        """Write it as the page has it."""
        rule = ("---", *("---" if name == "note" else "---:" for name in self.columns[1:]))
        lines = [f"| {' | '.join(cells)} |" for cells in (self.columns, rule, *self.rows)]
        return "\n".join([f"{self.title}:", "", *lines])


def tables(results: dict) -> Iterator[Table]:
    """Make the tables of the sections that were measured."""
    ours = [row for row in ROWS if row[1] in results]
    if ours:
        yield Table("Ratios", ("what", "time", "memory", "difference"), [_figures(results, *row) for row in ours])
    if "peers" in results:
        columns = ("over `gb.identify`", "time", "time over lstsq", "memory", "difference", "note")
        yield Table("Peers", columns, [_peer(name, row) for name, row in _fastest_first(results["peers"])])
    if "diagnosis" in results:
        of = results["diagnosis"]
        rows = [
            ("watched and diagnosed", _number(of["records_per_s"])),
            ("the same, its rows before the onset taken once", _number(of["named_per_s"])),
            ("a healthy watch", _number(of["healthy_per_s"])),
        ]
        yield Table("Records of 300 s at 100 Hz a second, one core", ("what", "records"), rows)
    for over, grown in results.get("growth", {}).items():
        title = {"samples": "Growth over samples, 101 taps", "taps": "Growth over taps, 20,000 samples"}[over]
        sizes = tuple(f"{size:,}" for size in grown["sizes"])
        time = ("time over the first's", *map(_number, grown["time_ratios"]), _number(grown["exponent"]))
        memory = ("peak memory (MB)", *map(_number, grown["memory_mb"]), "")
        yield Table(title, (over, *sizes, "exponent"), [time, memory])


def block(results: dict) -> str:
    """Write the page's block: the machine, then the tables."""
    machine = results["machine"]
    on = (
        f"{machine['cpu']}, {machine['cores']} cores, {machine['os']}; Python {machine['python']}, "
        f"numpy {machine['numpy']} ({machine['blas']}), scipy {machine['scipy']}, JSBSim {machine['jsbsim']}"
    )
    return "\n\n".join([f"Measured on {on}, one thread.", *(table.markdown() for table in tables(results))])


def _figures(results: dict, what: str, section: str, *keys: str) -> tuple[str, ...]:
    return (what, *(_with_target(results, section, key) for key in keys), *[""] * (3 - len(keys)))


def _with_target(results: dict, section: str, key: str) -> str:
    text = _number(results[section][key])
    target = (TARGETS | ALONE_TARGETS).get((section, key))
    if target is not None:
        sign, bound = target
        text += f" ({'at least' if sign == '>=' else 'at most'} {bound:g})"
    return text


def _fastest_first(peers: dict) -> list[tuple[str, dict]]:
    return sorted(peers.items(), key=lambda item: item[1].get("ratio", float("inf")))


def _peer(name: str, row: dict) -> tuple[str, ...]:
    if "failed" in row:
        return (name, "", "", "", "", row["failed"])
    keys = ("ratio", "lstsq_ratio", "memory_ratio", "markov_rel_diff")
    return (f"{name} {row['version']}", *(_number(row[key]) for key in keys), row["note"])


def _number(value: float) -> str:
    """Three digits, as ``0.012``, ``1.26``, ``14.5``, ``1,350`` or ``8.6e-13``."""
    if value == 0 or abs(value) >= 100:
        return f"{value:,.0f}"
    return f"{value:.2g}" if abs(value) < 1e-3 else f"{value:.3g}"
