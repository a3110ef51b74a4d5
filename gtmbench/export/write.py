"""The folder of C: written whole or not at all, the same bytes for the same monitor, with vectors of its own test."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank, bank_residuals
from gtmbench.detectors.monitor.scores import bank_alarms
from gtmbench.detectors.monitor_file import digest_in, digest_of_monitor, load_monitor
from gtmbench.detectors.protocol import Monitor
from gtmbench.detectors.statistics.learnt_noise import follower
from gtmbench.detectors.statistics.statistic import RawScore
from gtmbench.export.board import Board, BoardResidual, board_of
from gtmbench.export.source import fields_of, number, sizes_of, tables_of, times_to_catch_up
from gtmbench.faults.fault import inject
from gtmbench.faults.kinds.additive import Bias
from gtmbench.files.folders import atomic_folder, check_folder
from gtmbench.method.pseudo_inputs import derived
from gtmbench.values.channels import CHANNELS
from gtmbench.values.record import FloatArray, Record
from gtmbench.version import __version__

FILES = ("gtm_monitor.h", "gtm_monitor.c", "test_gtm_monitor.c", "CMakeLists.txt", "README.md")
_FIRST = 14  # blocks that the noise is learnt on


@dataclass(frozen=True, kw_only=True)
class Exported:
    """A folder of C that was written.

    Attributes
    ----------
    folder : Path
    digest : str
        Of the monitor that it came from.
    variant : str
        ``full`` or ``compact``.
    board : Board
        What is on board.

    Examples
    --------
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> import dataclasses
    >>> from gtmbench.detectors.statistics.statistic import Statistic
    >>> from gtmbench.export.board import board_of
    >>> noise = np.random.default_rng(1).standard_normal((9000, 2))
    >>> record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.02)
    >>> test = Statistic(windows_s=(0.2, 1.0), baseline_s=10.0)
    >>> bank = dataclasses.replace(gb.bank_between(["p"], ["q"]), statistic=test)
    >>> monitor = gb.calibrate([record] * 4, bank=bank, false_alarms_per_hour=1.0, estimator=gb.LeastSquares())
    >>> gb.Exported(folder=Path("c"), digest="", variant="full", board=board_of(monitor)).board.channels
    ('q', 'p')
    """

    folder: Path
    digest: str
    variant: str
    board: Board


def export_c(monitor: Monitor | str | Path, out: str | Path, *, compact: bool = False, force: bool = False) -> Exported:
    """Write a calibrated bank as C for a flight controller: a folder with code, its own test and a README.

    On board are detection with the noise that it learns, the sensors that are possible by structure, and the predicted
    reading of each watched sensor. Diagnosis, which names the sensor, the kind and the size, stays in Python.

    Parameters
    ----------
    monitor : Monitor, str or Path
        A calibrated bank, or the file that ``gtmbench calibrate`` wrote.
    out : str or Path
        The folder.
    compact : bool
        Whether the minute before a window is kept as means of a few samples: half of the memory, and alarms may come
        a few samples sooner or later.
    force : bool
        Whether files of the same names may be replaced.

    Raises
    ------
    InputError
        Where the monitor can't be exported (why, and which can), or the folder can't be written.

    Examples
    --------
    >>> import dataclasses
    >>> import tempfile
    >>> import numpy as np
    >>> from gtmbench.detectors.statistics.statistic import Statistic
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((9000, 2))
    >>> record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.02)
    >>> test = Statistic(windows_s=(0.2, 1.0), baseline_s=10.0)
    >>> bank = dataclasses.replace(gb.bank_between(["p"], ["q"]), statistic=test)
    >>> monitor = gb.calibrate([record] * 4, bank=bank, false_alarms_per_hour=1.0, estimator=gb.LeastSquares())
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     exported = gb.export_c(monitor, Path(folder, "board"), compact=True)
    ...     sorted(path.name for path in exported.folder.iterdir())
    ['CMakeLists.txt', 'README.md', 'SHA256SUMS', 'gtm_monitor.c', 'gtm_monitor.h', 'test_gtm_monitor.c']
    """
    out = Path(out)
    check_folder(out, force=force)
    if isinstance(monitor, str | Path):
        path = Path(monitor)
        calibrated: Monitor = load_monitor(path)
        digest = digest_in(path) or digest_of_monitor(calibrated)
    else:
        calibrated, digest = monitor, digest_of_monitor(monitor)
    board = board_of(calibrated)
    assert isinstance(calibrated, CalibratedBank)
    texts = rendered(calibrated, board, digest, compact=compact)
    with atomic_folder(out) as aside:
        for name, text in texts.items():
            (aside / name).write_text(text, encoding="utf-8", newline="\n")
    return Exported(folder=out, digest=digest, variant=_variant(compact=compact), board=board)


def rendered(monitor: CalibratedBank, board: Board, digest: str, *, compact: bool) -> dict[str, str]:
    """Return the texts of the folder's files by their names."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(  # C and Markdown: of a monitor's own texts none gets in, but names that `board` knows
        loader=PackageLoader("gtmbench.export", "c"),
        autoescape=False,  # noqa: S701
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    said = {**_common(board, digest, compact=compact), **_readme(board, compact=compact)}
    said |= _test(monitor, board, compact=compact)
    return {name: environment.get_template(f"{name}.jinja").render(said) for name in FILES}


def _variant(*, compact: bool) -> str:
    return "compact" if compact else "full"


def _common(board: Board, digest: str, *, compact: bool) -> dict[str, Any]:
    tables, checksum, summed = tables_of(board, compact=compact)
    return {
        "title": "A monitor of aircraft sensors.",
        "version": __version__,
        "digest": digest,
        "variant": _variant(compact=compact),
        "compact": compact,
        "sizes": sizes_of(board, compact=compact),
        "residual_bits": [(each.output.upper(), 1 << j) for j, each in enumerate(board.residuals)],
        "sensor_bits": [(name.upper(), 1 << j) for j, name in enumerate(board.channels)],
        "fields": fields_of(board),
        "lost_type": "uint8_t" if len(board.channels) <= 8 else "uint16_t",
        "tables": tables,
        "period_s": number(board.period_s),
        "checksum": f"{checksum:08X}",
        "summed": summed,
    }


def _readme(board: Board, *, compact: bool) -> dict[str, Any]:
    sizes = dict(sizes_of(board, compact=compact))
    learn_s = _FIRST * board.block * board.period_s
    return {
        "bank": "of gyros" if not board.name.isidentifier() else board.name,
        "rate": f"{1.0 / board.period_s:g}",
        "period_us": round(board.period_s * 1e6),
        "missing_most": str(sizes["MISSING_MOST"]).rstrip("u"),
        "residual_rows": [_residual_row(each, board) for each in board.residuals],
        "learn_s": f"{learn_s:g}",
        "caught_s": f"{times_to_catch_up(compact=compact) * learn_s:.3g}",
        "suspicion_s": f"{-(-board.suspicions[-1] // board.block) * board.block * board.period_s:g}",
        "baseline_s": f"{board.baseline * board.period_s:g}",
        "shortest": board.windows[0],
    }


def _residual_row(residual: BoardResidual, board: Board) -> str:
    known_s = residual.ahead * board.period_s
    cells = (residual.output, " ".join(residual.inputs), f"{known_s:g} s", " ".join(residual.suspects))
    return " | ".join(f"`{cell}`" if i in (0, 1, 3) else cell for i, cell in enumerate(cells))


def _test(monitor: CalibratedBank, board: Board, *, compact: bool) -> dict[str, Any]:
    vectors = vectors_of(monitor, board)
    statistics = (", ".join(_pairs(rows) for rows in check) for check in vectors.statistics)
    return {
        "rows": f"{len(vectors.readings)}u",
        "checks": f"{len(vectors.rows)}u",
        "steps": _floats(vectors.steps),
        "readings": [", ".join(map(str, row)) for row in vectors.readings.tolist()],
        "check_rows": ", ".join(map(str, vectors.rows.tolist())),
        "alarms": ", ".join(map(str, vectors.alarms.tolist())),
        "residuals": [_floats(row) for row in vectors.residuals],
        "statistics": list(statistics),
        "residual_off": number(2e-3 * max(float(np.nanstd(vectors.residuals)), 1e-3)),
        "statistic_relative": number(0.1 if compact else 0.02),
        "statistic_off": number(0.05 if compact else 0.01),
        "alarm_rows": 5 if compact else 1,
    }


def _pairs(rows: Any) -> str:
    return "{" + ", ".join("{" + _floats(pair) + "}" for pair in rows) + "}"


def _floats(values: Iterable[float]) -> str:
    return ", ".join("NAN" if np.isnan(value) else number(value) for value in values)


MISSING = -32768  # the least that 16 bits hold
_SECONDS, _ONSET_S, _HOLE_S = 21.0, 18.5, 17.0  # of vectors; when their fault begins, and the hole in them
_LEARNT = 2.5  # times what is learnt on first: then the C has caught up
_CHECKS = 12  # rows whose statistics are compared
_LONGEST_ROWS = 20_000  # of vectors: the test has to fit into a flight controller's flash
_DEVIATIONS = 12.0  # of the residual: the fault that the test puts in


@dataclass(frozen=True, kw_only=True, eq=False)
class Vectors:
    """Readings, and what is expected of them."""

    # shape (rows, channels); in steps; `MISSING` where one is missing
    readings: np.ndarray[tuple[int, int], np.dtype[np.int_]] = field(repr=False)
    steps: FloatArray  # shape (channels,); in the channels' units
    # shape (checks,); rows of the readings after which the rest is compared
    rows: np.ndarray[tuple[int], np.dtype[np.int_]]
    # shape (checks, residuals, windows, 2); of mean and energy, over their thresholds; NaN where there is none
    statistics: FloatArray = field(repr=False)
    residuals: FloatArray = field(repr=False)  # shape (checks, residuals); in the outputs' units
    # shape (residuals,); the row with which each is first above its threshold; -1 where none is
    alarms: np.ndarray[tuple[int], np.dtype[np.int_]]


def statistics_of(monitor: CalibratedBank, board: Board, output: str, raw: FloatArray) -> FloatArray:
    """Return statistics over their thresholds, shape (rows, windows, 2): mean, energy; NaN where nothing is tested."""
    white = follower(monitor.whiteners[output], board.period_s).push(raw)
    test, thresholds = monitor.bank.statistic, monitor.thresholds[output]
    told = np.full((len(raw), len(board.windows), 2), np.nan)
    scores: dict[str, RawScore] = {
        score.label: score
        for score in test.scores(raw[: len(white)], white, board.period_s, monitor.tolerances[output])
    }
    for w, rows in enumerate(board.windows):
        for kind, name in enumerate(("mean", "energy")):
            label = f"{name} {rows * board.period_s:g} s"
            told[: len(white), w, kind] = scores[label].values / thresholds[label]
    return told


def vectors_of(monitor: CalibratedBank, board: Board) -> Vectors:
    """Return vectors for a monitor: a healthy flight that is made up, with a hole, and a bias at its end."""
    period_s = board.period_s
    late = max(_ONSET_S / period_s, board.least_baseline + board.windows[0] + _LEARNT * 14 * board.block)
    rows = min(round(late + (_SECONDS - _ONSET_S) / period_s), _LONGEST_ROWS)
    readings, steps, record = _quantised(_flown(monitor, board, rows), board, (rows - round(2.5 / period_s)) * period_s)
    residuals = bank_residuals(monitor, record).raw
    first = round(_LEARNT * 14 * board.block) + max(each.ahead for each in board.residuals)
    checks = np.unique(np.linspace(first, rows - 1, _CHECKS).astype(int))
    statistics, expected = [], []
    for each in board.residuals:
        at = checks - each.ahead
        statistics.append(statistics_of(monitor, board, each.output, residuals[each.output])[at])
        expected.append(residuals[each.output][at])
    first_s: dict[str, float] = {}
    for crossing in bank_alarms(monitor, record):
        first_s.setdefault(crossing.output, crossing.time_s)
    crossed = {output: round((time_s - record.start_s) / period_s) for output, time_s in first_s.items()}
    there = np.isfinite(np.stack(statistics, axis=1)[:, :, 0, 0]).all(axis=1)  # beside a hole nothing is judged
    return Vectors(
        readings=readings,
        steps=steps,
        rows=checks[there],
        statistics=np.stack(statistics, axis=1)[there],
        residuals=np.stack(expected, axis=1)[there],
        alarms=np.array([crossed.get(each.output, -1) for each in board.residuals]),
    )


def _flown(monitor: CalibratedBank, board: Board, rows: int) -> Record:
    """Return readings of a made-up flight; gyros read what the attitude turns by, and noise."""
    random, time_s = np.random.default_rng(1), np.arange(rows + 2) * board.period_s
    waves = {"phi": (0.0, 8.0, 1.1), "theta": (4.0, 3.0, 1.7), "psi": (60.0, 12.0, 0.5)}
    angles = {name: middle + size * np.sin(turn * time_s + turn) for name, (middle, size, turn) in waves.items()}
    attitude = Record(np.column_stack([*angles.values()]), channels=[*angles], sample_period_s=board.period_s)
    rates = dict(zip("pqr", derived(attitude, ("p_att", "q_att", "r_att")), strict=True))
    columns = []
    for i, name in enumerate(board.channels):
        told = {**angles, **rates}.get(name, 5.0 + np.sin(0.7 * time_s + i))[1:-1]
        own = monitor.operators.get(name)
        noise = float(own.rms_residual[0]) if own is not None else CHANNELS[name].noise
        columns.append(told + noise * random.standard_normal(rows))
    return Record(np.column_stack(columns), channels=board.channels, sample_period_s=board.period_s)


def _quantised(
    record: Record, board: Board, onset_s: float
) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.int_]], FloatArray, Record]:
    """Return readings in whole steps, the steps, and the record that they are; with a hole, and broken at the end."""
    broken = board.channels[0]
    size = _DEVIATIONS * float(np.std(record[broken] - np.convolve(record[broken], np.ones(5) / 5.0, mode="same")))
    values = inject(record, Bias(channel=broken, onset_s=onset_s, size=size)).matrix(board.channels).copy()
    hole = round(_HOLE_S / board.period_s)
    values[hole : hole + 2] = np.nan
    values[hole + 40 : hole + 41, 0] = np.nan
    steps = np.float32(1.05 * np.nanmax(np.abs(values), axis=0) / 32_000.0).astype(float)
    whole = np.where(np.isnan(values), MISSING, np.round(values / steps)).astype(int)
    values = np.where(whole == MISSING, np.nan, (whole * steps).astype(np.float32))
    return whole, steps, Record(values, channels=board.channels, sample_period_s=board.period_s)
