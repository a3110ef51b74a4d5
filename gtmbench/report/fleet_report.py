"""A fleet of logs, watched and written down: the table, the figure of its gyros, a report, beside the parts."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gtmbench.checks import one_line
from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.bank.composed import AUTO
from gtmbench.detectors.protocol import Detector, Monitor
from gtmbench.files.folders import atomic_folder
from gtmbench.files.plain import described
from gtmbench.files.writing import is_file, write_text
from gtmbench.jobs.parts import Parts
from gtmbench.jobs.progress import Progress, silent
from gtmbench.log.fleet import LIMIT_S, FleetQuestion, Kept, Source, conduct
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.fleet import COLUMNS, fleet_page, fleet_row, gyros_figure
from gtmbench.report.page.flight import flight_page
from gtmbench.values.record import Span
from gtmbench.verdict.scope import judge_text
from gtmbench.verdict.verdict import Outcome

if TYPE_CHECKING:
    import pandas as pd

TABLE, FIGURE, REPORT, PAGES = "fleet.parquet", "gyros.png", "fleet.html", "pages"
_ODD = re.compile(r"[^A-Za-z0-9._-]")  # in a file's name


def watch_fleet(
    sources: Sequence[str | Path],
    detector: Detector | Monitor | Bank | str | Path = AUTO,
    *,
    out: str | Path,
    healthy: Sequence[Span | str | Path] = (),
    mapping: Sequence[str] = (),
    rate_hz: float | None = None,
    false_alarms_per_hour: float | None = None,
    judge: str | Sequence[str] | None = None,
    limits: Sequence[str] = (),
    limit_s: float = LIMIT_S,
    jobs: int = 1,
    scheduler: str | None = None,
    tls: Path | None = None,
    resume: bool = False,
    progress: Progress = silent,
) -> pd.DataFrame:
    """Watch many logs, each in a process of its own, and return a row a log.

    A log that can't be read, takes too long or kills its process is a row with its error.

    Parameters
    ----------
    sources : sequence of str or Path
        Logs, patterns, and folders, which stand for all logs in them; or addresses of objects, as fsspec takes them.
    detector, healthy, mapping, rate_hz, false_alarms_per_hour, judge, limits
        As in `watch_log`. Spans apply to each log, and other logs that serve as healthy aren't watched.
    out : str or Path
        The folder of the parts, one a log, of ``fleet.parquet``, ``gyros.png``, ``fleet.html``, and of a page for each
        log on which something failed or nobody can tell.
    limit_s : float
        Time limit for one log, in seconds.
    jobs, scheduler, tls, resume, progress
        As `campaign` takes them.

    Returns
    -------
    DataFrame
        In the order in which the logs were given; its columns are `gtmbench.report.fleet.COLUMNS`.

    Raises
    ------
    InputError
        If there is no log, none could be watched, or the folder belongs to another fleet or is in use.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((3000, 2))
    >>> record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.write_log(record, f"{folder}/flight.csv")
    ...     rows = gb.watch_fleet(
    ...         [f"{folder}/flight.csv"], gb.bank_between(["p"], ["q"]), healthy=[(0.0, 60.0)], out=f"{folder}/out"
    ...     )
    >>> rows["outcome"].tolist()
    ['healthy']
    """
    watching = FleetQuestion(
        detector=detector,
        healthy=tuple(Path(each) if isinstance(each, str) else each for each in healthy),
        mapping=tuple(mapping),
        rate_hz=rate_hz,
        false_alarms_per_hour=false_alarms_per_hour,
        judge=judge_text(judge),
        limits=tuple(limits),
        limit_s=limit_s,
    )
    by = {"jobs": jobs, "scheduler": scheduler, "tls": tls, "resume": resume, "progress": progress}
    return written(watching.logs_of(sources), watching, Path(out), **by).read().to_pandas()


def written(logs: Sequence[Source], watching: FleetQuestion, out: Path, **by: Any) -> Parts:
    """Watch what isn't in a folder yet (`by` is as `conduct` takes it), write what is made of it; return the parts."""
    row, keep = partial(_kept, options=_options(watching)), partial(_keep_page, out / PAGES)
    parts = conduct(logs, watching, out, row=row, keep=keep, columns=COLUMNS, **by)
    with atomic_folder(out) as aside:
        write_fleet(parts, aside, out / PAGES)
    return parts


def _kept(watched: WatchedLog, *, options: Sequence[str]) -> Kept:
    if watched.verdict.outcome is Outcome.HEALTHY:
        return Kept(fleet_row(watched))
    command = shlex.join(["gtmbench", "monitor", watched.log.path.name, *options])
    return Kept(fleet_row(watched), flight_page(watched, command))


def _keep_page(pages: Path, log: Source, page: str) -> None:
    pages.mkdir(exist_ok=True)
    write_text(pages / page_name(one_line(str(log))), page)


def _options(watching: FleetQuestion) -> list[str]:
    """Return what makes one log be watched as the fleet's are."""
    detector = watching.detector
    named = ["--detector", Path(detector).name] if isinstance(detector, (str, Path)) and str(detector) != AUTO else []
    spans = [each.name if isinstance(each, Path) else f"{each[0]:g}:{each[1]:g}" for each in watching.healthy]
    rate = [] if watching.rate_hz is None else ["--rate", f"{watching.rate_hz:g}"]
    listed = [
        word
        for key, texts in (
            ("--healthy", spans),
            ("--map", watching.mapping),
            ("--judge", [] if watching.judge is None else [watching.judge]),
            ("--limit", watching.limits),
        )
        for text in texts
        for word in (key, text)
    ]
    return [*named, *listed, *rate]


def page_name(log: str) -> str:
    """Return what the page of a log is called: by its file's name, and apart from its namesakes in other folders."""
    return f"{_ODD.sub('_', Path(log).name)[:80]}-{sha256(log.encode()).hexdigest()[:6]}.html"


def write_fleet(parts: Parts, folder: Path, pages: Path) -> None:
    """Write ``fleet.parquet``, ``gyros.png`` if a log tells of any, and ``fleet.html``, which links to the `pages`."""
    import pyarrow.parquet as pq

    table = parts.read()
    pq.write_table(described(table, COLUMNS), folder / TABLE)
    figure = gyros_figure(table.to_pandas())
    if figure is not None:
        figure.savefig(folder / FIGURE, dpi=110)
    rows = table.to_pylist()
    names = {row["log"]: page_name(row["log"]) for row in rows}
    own = {log: f"{PAGES}/{name}" for log, name in names.items() if is_file(pages / name)}
    picture = (folder / FIGURE).read_bytes() if figure is not None else b""
    (folder / REPORT).write_text(fleet_page(rows, own, picture), encoding="utf-8")
