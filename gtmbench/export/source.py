"""A board's numbers as C: sizes, tables and formulas, and the checksum by which the folder's own test knows them."""

from __future__ import annotations

import math
import re
import struct
import zlib
from collections.abc import Iterable, Sequence

import numpy as np

from gtmbench.detectors.statistics.statistic import ordinary_powers
from gtmbench.export.board import DERIVED, Board, BoardResidual
from gtmbench.values.channels import CHANNELS
from gtmbench.values.record import FloatArray

RECENT, LATE, GROUPS = 52, 28, 11  # blocks of the noise's memory; old ones in groups of 34
_FIRST = 14  # blocks at least
_ROWS_A_CALL = {  # of each pass over rows that wait while the noise is learnt, and of judging them: not, and compact
    False: (0, 80, 15, 60, 15, 15, 15, 3),
    True: (0, 80, 25, 70, 22, 25, 25, 3),  # there is no room for more that wait
}
_CENTRINGS = 7  # passes of the first kind
_SUSPECTED = 12.0  # nats
_SCALE, _MOST = 320.0, 100.0  # of a stored sample, as the code has it, and its bound in deviations


def sizes_of(board: Board, *, compact: bool) -> list[tuple[str, object]]:
    """Return the sizes that the header defines, by name."""
    longest = board.windows[-1]
    ring = max(longest if compact else longest + board.baseline, board.suspicions[-1]) + 1
    shortest = board.windows[0]
    means = (longest + board.baseline) // shortest + 3
    store = 2 * (ring + means * compact)
    room = [count for count in range(_FIRST, LATE + 1) if _waiting_bytes(board, count, compact=compact) <= store]
    first_most = max(room, default=_FIRST)
    waiting = _waiting(board, first_most, compact=compact)
    most = max(store, _waiting_bytes(board, first_most, compact=compact))
    there = -(-board.suspicions[-1] // 32) * 32
    sizes: list[tuple[str, object]] = [
        ("COMPACT", int(compact)),
        ("PERIOD_US", f"{round(board.period_s * 1e6)}u"),
        ("RESIDUALS", f"{len(board.residuals)}u"),
        ("CHANNELS", f"{len(board.channels)}u"),
        ("DERIVED", f"{len(board.derived)}u"),
        ("WINDOWS", f"{len(board.windows)}u"),
        ("BASELINE", f"{board.baseline}u"),
        ("LEAST_BASELINE", f"{board.least_baseline}u"),
        ("RING", f"{ring}u"),
        ("INPUTS_MOST", f"{max(len(each.inputs) for each in board.residuals)}u"),
        ("TAPS_MOST", f"{max(each.markov.shape[1] for each in board.residuals)}u"),
        ("READS_MOST", f"{max(_reads(board, each) for each in board.residuals)}u"),
        ("WHITE_MOST", f"{max(len(each.whitener) for each in board.residuals)}u"),
        ("ORDER", f"{board.order}u"),
        ("BLOCK", f"{board.block}u"),
        ("LASTING", f"{board.lasting}u"),
        ("ECHO", f"{board.echo}u"),
        ("APART", f"{board.apart}u"),
        ("RECENT", f"{RECENT}u"),
        ("LATE", f"{LATE}u"),
        ("GROUPS", f"{GROUPS}u"),
        ("SUSPICIONS", f"{len(board.suspicions)}u"),
        ("SUSPICIONS_ARE_WINDOWS", int(set(board.suspicions) <= set(board.windows))),
        ("THERE", f"{there}u"),
        ("THERE_WORDS", f"{there // 32}u"),
        ("WAITING", f"{waiting}u"),
        ("FIRST_MOST", f"{first_most}u"),
        ("SQUARE_SHIFT", f"{square_shift(board)}u"),
        ("LOST", f"{board.lost}u"),
        ("MISSING_MOST", f"{max(round(0.25 / board.period_s), 1)}u"),
    ]
    if compact:
        sizes += [
            ("SHORTEST", f"{shortest}u"),
            ("MEANS", f"{means}u"),
            ("MEANS_ROOM", f"{most // 2 - ring}u"),
            ("BASE_BLOCKS", f"{board.baseline // shortest}u"),
            ("PERIOD", f"{shortest * means}u"),
        ]
    sizes += [(f"AHEAD_{each.output.upper()}", f"{each.ahead}u") for each in board.residuals]
    return sizes


def times_to_catch_up(*, compact: bool) -> float:
    """Return how many times the rows that are learnt from have come once all that waited have been judged.

    Passes over n rows take ``7 n / r_1 + n / r_2 + ... + n / r_6`` calls, and judging, r_7 rows a call, makes up for
    r_7 - 1 of them; and a twentieth.
    """
    _, centring, *others, judged = _ROWS_A_CALL[compact]
    passes = _CENTRINGS / centring + sum(1.0 / rows for rows in others)
    return 1.05 * (1.0 + passes) * judged / (judged - 1)


def _waiting(board: Board, blocks: int, *, compact: bool) -> int:
    return math.ceil(times_to_catch_up(compact=compact) * blocks * board.block) + 50


def _waiting_bytes(board: Board, blocks: int, *, compact: bool) -> int:
    """Return the memory of rows that wait, with that of the means which are stored before the last has been judged."""
    waiting = _waiting(board, blocks, compact=compact)
    return 4 * waiting + 2 * (waiting // board.windows[0] + 2) * compact


def _reads(board: Board, residual: BoardResidual) -> int:
    """Return how many of its output's readings a residual waits for: a derived one comes a row later."""
    return max(residual.ahead, 1) if residual.output in board.derived else residual.ahead + 1


def tables_of(board: Board, *, compact: bool) -> tuple[list[str], int, list[str]]:
    """Return the tables as C, the CRC-32 of the reals as the folder's own test has it, and their names in order."""
    own, tables = board.residuals, _Tables()
    tables.whole("WINDOW_ROWS", board.windows)
    tables.whole("SUSPICION_ROWS", board.suspicions)
    own_place = {rows: w for w, rows in enumerate(board.windows)}
    tables.whole("SUSPICION_WINDOWS", [own_place.get(rows, 0) for rows in board.suspicions])
    nats = [_SUSPECTED - math.log(rows / board.suspicions[0]) for rows in board.suspicions]
    powers = np.array([ordinary_powers(rows, least) for rows, least in zip(board.suspicions, nats, strict=True)])
    near = np.sqrt(2.0 * np.array(nats) / board.suspicions)
    tables.real("SUSPICIONS", _tests(board, board.suspicions, near, powers, nats, nats).ravel())
    tables.whole("ROWS_A_CALL", _ROWS_A_CALL[compact])
    tables.whole("TAPS", [each.markov.shape[1] for each in own])
    tables.whole("AHEAD", [each.ahead for each in own])
    tables.whole("READS", [_reads(board, each) for each in own])
    tables.whole("IS_LATE", [int(each.is_late) for each in own])
    tables.whole("OUTPUTS", [board.signals.index(each.output) for each in own])
    tables.whole("INPUT_COUNTS", [len(each.inputs) for each in own])
    most = max(len(each.inputs) for each in own)
    tables.wholes(
        "INPUTS",
        [[board.signals.index(name) for name in each.inputs] + [0] * (most - len(each.inputs)) for each in own],
    )
    tables.real("OFFSETS", [each.offset for each in own])
    tables.pointed("MARKOV", [np.tile(each.markov, 2).ravel() for each in own])  # twice: see `dot`
    tables.whole("WHITE_TAPS", [len(each.whitener) for each in own])
    tables.real("WHITENER_SUMS", [float(each.whitener.sum()) for each in own])
    tables.pointed("WHITENERS", [np.tile(each.whitener, 2) for each in own])
    tables.reals("TOLERANCES", [each.tolerance for each in own])
    tests = [
        _tests(
            board, board.windows, board.near(each), board.ordinary(each), each.mean_thresholds, each.energy_thresholds
        )
        for each in own
    ]
    tables.pointed("TESTS", [rows.ravel() for rows in tests])
    tables.whole("AFFECTED_BY", [mask(board, each.suspects) for each in own], kind="uint32_t")
    return [*tables.lines, _derive(board)], tables.checksum, tables.names


def square_shift(board: Board) -> int:
    """Return by how many bits squares of stored samples are shortened, so that a window's sum of them fits 32 bits.

    The least s with ``rows 32000^2 / 2^s < 2^32``, for the longest window: each square is rounded, by half of
    ``2^s / 320^2`` of the noise's power at most.
    """
    return max(math.ceil(math.log2(board.windows[-1] * (_MOST * _SCALE) ** 2 / 2.0**32)), 1)


def _tests(
    board: Board,
    rows: Sequence[int],
    near: FloatArray,
    powers: FloatArray,
    mean_nats: Sequence[float] | FloatArray,
    energy_nats: Sequence[float] | FloatArray,
) -> FloatArray:
    """Return what windows are judged by, shape (windows, 7): the columns are those of the code's enumeration."""
    share = 1.0 / (np.array(rows) * _SCALE)
    return np.column_stack([share, share * 2.0 ** square_shift(board) / _SCALE, near, powers, mean_nats, energy_nats])


def mask(board: Board, names: Iterable[str]) -> int:
    """Return the bits of some sensors."""
    return sum(1 << board.channels.index(name) for name in names)


class _Tables:
    """Tables as lines of C, and a checksum of what they hold."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.names: list[str] = []
        self.checksum = 0

    def whole(self, name: str, values: Sequence[int], kind: str = "uint16_t") -> None:
        numbers = ", ".join(f"{value}u" for value in values)
        self.lines.append(f"static const {kind} {name}[{len(values)}] = {{{numbers}}};")

    def wholes(self, name: str, rows: Sequence[Sequence[int]]) -> None:
        numbers = ", ".join("{" + ", ".join(f"{value}u" for value in row) + "}" for row in rows)
        self.lines.append(f"static const uint16_t {name}[{len(rows)}][{len(rows[0])}] = {{{numbers}}};")

    def real(self, name: str, values: Iterable[float]) -> None:
        numbers = [float(np.float32(value)) for value in values]
        self._sum(name, numbers)
        self.lines.append(f"static const float {name}[{len(numbers)}] = {{{_joined(numbers)}}};")

    def reals(self, name: str, rows: Iterable[Iterable[float]]) -> None:
        numbers = [[float(np.float32(value)) for value in row] for row in rows]
        self._sum(name, [value for row in numbers for value in row])
        joined = ",\n    ".join("{" + _joined(row) + "}" for row in numbers)
        self.lines.append(f"static const float {name}[{len(numbers)}][{len(numbers[0])}] = {{\n    {joined}}};")

    def pointed(self, name: str, rows: Iterable[Iterable[float]]) -> None:
        given = [list(row) for row in rows]
        for j, row in enumerate(given):
            self.real(f"{name}_{j}", row)
        pointers = ", ".join(f"{name}_{j}" for j in range(len(given)))
        self.lines.append(f"static const float *const {name}[{len(given)}] = {{{pointers}}};")

    def _sum(self, name: str, numbers: Sequence[float]) -> None:
        self.names.append(name)
        self.checksum = zlib.crc32(struct.pack(f"<{len(numbers)}f", *numbers), self.checksum)


def _joined(values: Iterable[float]) -> str:
    return ", ".join(number(value) for value in values)


def number(value: float) -> str:
    """Return a float as C writes it, exactly."""
    if math.isinf(value):
        return "INFINITY" if value > 0.0 else "-INFINITY"
    told = f"{float(np.float32(value)):.9g}"
    return f"{told}f" if "." in told or "e" in told else f"{told}.0f"


def _derive(board: Board) -> str:
    """Return the function that works out pseudo inputs at the middle one of three samples."""

    def formula(name: str) -> str:
        told = re.sub(r"S\((\w+)\)", lambda found: f"slope_of(state, {place[found[1]]}u)", DERIVED[name])
        told = re.sub(r"A\((\w+)\)", lambda found: f"(RADIANS * state->middle[{place[found[1]]}u])", told)
        return re.sub(r"V\((\w+)\)", lambda found: f"state->middle[{place[found[1]]}u]", told)

    place = {name: i for i, name in enumerate(board.channels)}
    body = [f"    derived[{i}] = {formula(name)}; /* {name} */" for i, name in enumerate(board.derived)]
    lines = [
        "static float slope_of(const gtm_monitor_state *state, unsigned channel);",
        "",
        "/* Pseudo inputs at the middle one of three samples, in deg/s. */",
        "static void derive(const gtm_monitor_state *state, float *derived)",
        "{",
        *(body or ["    (void)state;"]),
        "    derived[GTM_MONITOR_DERIVED] = 0.0f;",
        "}",
    ]
    return "\n".join(lines)


def fields_of(board: Board) -> list[tuple[str, str]]:
    """Return the fields of a sample, and what each is."""
    return [(CHANNELS[name].header, f"{CHANNELS[name].meaning}, {CHANNELS[name].unit}") for name in board.channels]
