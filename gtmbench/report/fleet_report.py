"""A fleet of logs, watched and written down: the table, the figure of its gyros, a report, beside the parts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.bank.composed import AUTO
from gtmbench.detectors.protocol import Detector, Monitor
from gtmbench.files.arrow_table import Row
from gtmbench.files.folders import atomic_folder
from gtmbench.jobs.parts import Parts
from gtmbench.jobs.progress import Progress, silent
from gtmbench.report.figures.fleet import gyros_figure
from gtmbench.report.tables.fleet import COLUMNS, fleet_row, worst_first
from gtmbench.report.tables.markdown import markdown
from gtmbench.report.words.fleet import MEANING, counts_text, fleet_table, full_lines
from gtmbench.study.log.log_fleet import LIMIT_S, Watching, conduct
from gtmbench.values.record import Span

if TYPE_CHECKING:
    import pandas as pd

TABLE, FIGURE, REPORT = "fleet.parquet", "gyros.png", "report.md"
_WIDTH = 140  # of the table, in characters
_MARKS = re.compile(r"[|<`*\[\]\\]")


def watch_fleet(
    sources: Sequence[str | Path],
    detector: Detector | Monitor | Bank | str | Path = AUTO,
    *,
    out: str | Path,
    healthy: Sequence[Span | str | Path] = (),
    mapping: Sequence[str] = (),
    rate_hz: float | None = None,
    false_alarms_per_hour: float | None = None,
    limit_s: float = LIMIT_S,
    jobs: int = 1,
    resume: bool = False,
    progress: Progress = silent,
) -> pd.DataFrame:
    """Watch many logs, each in a process of its own, and return a row a log.

    A log that can't be read, takes too long or kills its process is a row with its error.

    Parameters
    ----------
    sources : sequence of str or Path
        Logs, patterns, and folders, which stand for all logs in them.
    detector, healthy, mapping, rate_hz, false_alarms_per_hour
        As in `watch_log`. Spans apply to each log, and other logs that serve as healthy aren't watched.
    out : str or Path
        The folder of the parts, one a log, of ``fleet.parquet``, ``gyros.png`` and ``report.md``.
    limit_s : float
        Time limit for one log, in seconds.
    jobs, resume, progress
        As `campaign` takes them.

    Returns
    -------
    DataFrame
        In the order in which the logs were given; its columns are `gtmbench.report.tables.fleet.COLUMNS`.

    Raises
    ------
    InputError
        If there is no log, none could be watched, or the folder belongs to another fleet or is in use.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((1500, 2))
    >>> record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.write_log(record, f"{folder}/flight.csv")
    ...     rows = gb.watch_fleet(
    ...         [f"{folder}/flight.csv"], gb.bank_between(["p"], ["q"]), healthy=[(0.0, 30.0)], out=f"{folder}/out"
    ...     )
    >>> rows["outcome"].tolist()
    ['healthy']
    """
    parted = tuple(Path(each) if isinstance(each, str) else each for each in healthy)
    watching = Watching(
        detector=detector,
        healthy=parted,
        mapping=tuple(mapping),
        rate_hz=rate_hz,
        false_alarms_per_hour=false_alarms_per_hour,
        limit_s=limit_s,
    )
    logs = watching.logs_of(sources)
    return written(logs, watching, Path(out), jobs=jobs, resume=resume, progress=progress).read().to_pandas()


def written(
    logs: Sequence[Path],
    watching: Watching,
    out: Path,
    *,
    jobs: int = 1,
    resume: bool = False,
    progress: Progress = silent,
) -> Parts:
    """Watch what isn't in a folder yet, write what is made of all of it beside, and return the parts."""
    parts = conduct(logs, watching, out, row=fleet_row, columns=COLUMNS, jobs=jobs, resume=resume, progress=progress)
    with atomic_folder(out) as aside:
        write_fleet(parts, aside)
    return parts


def write_fleet(parts: Parts, folder: Path) -> None:
    """Write ``fleet.parquet``, a row a log in the order in which they were given, ``gyros.png`` and ``report.md``.

    Where no log tells anything of a gyro there is no figure.
    """
    import pyarrow.parquet as pq

    table = parts.read()
    pq.write_table(table, folder / TABLE)
    figure = gyros_figure(table.to_pandas())
    if figure is not None:
        figure.savefig(folder / FIGURE, dpi=110)
    (folder / REPORT).write_text(_report(table.to_pylist(), has_figure=figure is not None), encoding="utf-8")


def _report(rows: list[Row], *, has_figure: bool) -> str:
    """Return a table that is cut as on a screen, the figure, and every log's verdict in full."""
    import pandas as pd

    worst = worst_first(rows)
    names, cells = fleet_table(worst, _WIDTH)
    table = markdown(pd.DataFrame([[_as_text(cell) for cell in line] for line in cells], columns=names))
    lines = [
        "# A fleet of logs",
        "",
        counts_text(row["outcome"] for row in rows),
        "",
        table,
        "",
        f"{'; '.join(MEANING.values())}.",
    ]
    if has_figure:
        lines += ["", f"![Each gyro's residual, bias and noise, flight by flight]({FIGURE})"]
    for row in worst:
        lines += ["", f"**{_as_text(row['log'])}**", *(f"- {_as_text(line)}" for line in full_lines(row))]
    return "\n".join([*lines, ""])


def _as_text(text: str) -> str:
    """Return a text that Markdown takes for nothing else: files and logs may say anything."""
    return _MARKS.sub(r"\\\g<0>", text)
