"""Exported monitors, compiled and run: on this machine, and on a Cortex-M4 that qemu plays."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gtmbench.errors import GtmbenchError
from gtmbench.export.board import Board
from gtmbench.values.channels import CHANNELS
from gtmbench.values.record import FloatArray

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-pedantic", "-Werror")
M4_TOOLS = ("arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm")
M4_INSTALL = "apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
_M4 = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
_TICKS = 25.6  # of the board's timer (25 MHz) an instruction, which takes 2**10 ns there
_LONGEST_S = 300.0
Array = np.ndarray[Any, np.dtype[Any]]


def compiler() -> str | None:
    """Return this machine's C compiler."""
    return next((found for name in ("gcc", "clang", "cc") if (found := shutil.which(name))), None)


def missing_tools() -> list[str]:
    """Return which tools for a Cortex-M4 aren't installed."""
    return [name for name in M4_TOOLS if shutil.which(name) is None]


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardOutput:
    """What an exported monitor said, a row a sample."""

    # alarms, above, possible, involved, missing, flags, backlog: shape (rows,); as the events have them
    alarms: Array = field(repr=False)
    above: Array = field(repr=False)
    possible: Array = field(repr=False)
    involved: Array = field(repr=False)
    missing: Array = field(repr=False)
    flags: Array = field(repr=False)
    backlog: Array = field(repr=False)
    # shape (rows, residuals, windows, 2); over their thresholds, of mean and of energy; none where they weren't asked
    # for
    statistics: Array = field(repr=False)
    # predicted, residuals, levels: shape (rows, residuals)
    predicted: Array = field(repr=False)
    residuals: Array = field(repr=False)
    levels: Array = field(repr=False)


class Compiled:
    """An exported folder as a library of this machine; every state of `begin` is a monitor of its own.

    `folder`: as `gtmbench.export_c` wrote it; it isn't written to.
    """

    def __init__(self, folder: Path, board: Board, aside: Path, *flags: str) -> None:
        driver, library = _file("driver.c"), (aside / "monitor.so").resolve()
        command = [compiler() or "cc", *STRICT, "-O2", "-ffp-contract=off", *flags, "-shared", "-fPIC", f"-I{folder}"]
        _run([*command, str(folder / "gtm_monitor.c"), str(driver), "-o", str(library), "-lm"])
        self._library = ctypes.CDLL(str(library))
        self._library.state_bytes.restype = ctypes.c_ulong
        self.board = board
        self.state_bytes = int(self._library.state_bytes())

    def begin(self) -> ctypes.Array[ctypes.c_char]:
        """Return the memory of a monitor that knows nothing."""
        state = ctypes.create_string_buffer(self.state_bytes)
        self._library.gtm_monitor_init(state)
        return state

    def run(
        self,
        values: FloatArray,
        *,
        times_us: Array | None = None,
        state: ctypes.Array[ctypes.c_char] | None = None,
        statistics: bool = True,
    ) -> BoardOutput:
        """Return what a monitor says of rows of the board's channels, shape (rows, channels).

        `times_us`: by default a period apart. `state`: of `begin`, which goes on; by default a new one.
        """
        board, rows = self.board, np.ascontiguousarray(values, dtype=np.float32)
        even_us = 1_000_000 + np.arange(len(rows)) * round(board.period_s * 1e6)
        times = np.ascontiguousarray(even_us if times_us is None else times_us, dtype=np.uint64)
        residuals, windows = len(board.residuals), len(board.windows)
        events = np.zeros((len(rows), 7), dtype=np.uint32)
        tests = np.full((len(rows) * statistics, residuals, windows, 2), np.nan, dtype=np.float32)
        others = np.full((len(rows) * statistics, residuals, 3), np.nan, dtype=np.float32)
        self._library.run(
            self.begin() if state is None else state,
            rows.ctypes,
            times.ctypes,
            ctypes.c_long(len(rows)),
            events.ctypes,
            tests.ctypes if statistics else None,
            others.ctypes if statistics else None,
        )
        alarms, above, possible, involved, missing, flags, backlog = events.T.astype(int)
        return BoardOutput(
            alarms=alarms,
            above=above,
            possible=possible,
            involved=involved,
            missing=missing,
            flags=flags,
            backlog=backlog,
            statistics=tests,
            predicted=others[:, :, 0],
            residuals=others[:, :, 1],
            levels=others[:, :, 2],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class OnM4:
    """An exported monitor on a Cortex-M4 with an FPU, as far as a PC goes."""

    flash_bytes: int  # code and tables, compiled for size; without the library's functions
    state_bytes: int
    # shape (rows,); A call, of a made-up flight whose last third has a fault
    instructions: FloatArray = field(repr=False)
    said: str  # by the folder's own test


def run_on_m4(folder: Path, board: Board, aside: Path, *, optimised: str = "-O2") -> OnM4:
    """Cross-compile an exported folder, run its own test in qemu's M4 machine, and count instructions a call.

    `optimised`: how it is compiled where instructions are counted. Flash is always of ``-Os``.
    """
    if missing_tools():
        raise GtmbenchError(f"{', '.join(missing_tools())} isn't installed here; {M4_INSTALL}")
    noises = ", ".join(f"{CHANNELS[name].noise:.6g}f" for name in board.channels)
    (aside / "count.c").write_text(
        f"static const float NOISES[] = {{{noises}}};\n" + _file("m4_count.c").read_text(encoding="utf-8"),
        encoding="utf-8",
    )
    gcc, size = "arm-none-eabi-gcc", "arm-none-eabi-size"
    _run([gcc, "-std=c99", "-Os", *_M4, "-c", str(folder / "gtm_monitor.c"), "-o", str(aside / "monitor.o")])
    flash = _run([size, str(aside / "monitor.o")]).splitlines()[1].split()
    linked = ["--specs=rdimon.specs", "-T", str(_file("m4.ld")), f"-I{folder}"]
    sources = [str(aside / "count.c"), str(_file("m4_start.c"))]
    _run([gcc, "-std=gnu99", optimised, *_M4, *linked, *sources, "-o", str(aside / "m4.elf"), "-lm"])
    machine = ["qemu-system-arm", "-M", "mps2-an386", "-nographic", "-icount", "shift=10"]
    semihosting = ["-semihosting-config", "enable=on,target=native", "-kernel", str(aside / "m4.elf")]
    told = _run([*machine, *semihosting])
    counted = np.array([line.split() for line in told.splitlines() if line[:1].isdigit()], dtype=float)
    said = told.splitlines()[0]
    state = re.search(r"(\d+) bytes of state", said)
    return OnM4(
        flash_bytes=int(flash[0]) + int(flash[1]),
        state_bytes=int(state[1]) if state else 0,
        instructions=counted[:, 1] / _TICKS,
        said=said,
    )


def _file(name: str) -> Path:
    return Path(__file__).parent / "c" / name


def _run(command: list[str]) -> str:
    try:
        ended = subprocess.run(
            command, capture_output=True, text=True, check=True, timeout=_LONGEST_S, stdin=subprocess.DEVNULL
        )
    except subprocess.CalledProcessError as error:
        said = (error.stderr or error.stdout)[:2000]
        raise GtmbenchError(f"{command[0]} ended with {error.returncode}: {said}") from error
    return ended.stdout
