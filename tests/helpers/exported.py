"""Exported monitors, compiled for this machine and run on records."""

import ctypes
import shutil
import subprocess
from dataclasses import dataclass

import numpy as np

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-pedantic", "-Werror"]
COMPILER = shutil.which("gcc") or shutil.which("clang") or shutil.which("cc")

_DRIVER = r"""
#include "gtm_monitor.h"
#include <string.h>
enum { R = GTM_MONITOR_RESIDUALS, W = GTM_MONITOR_WINDOWS };
unsigned long state_bytes(void);
void run(gtm_monitor_state *s, const float *rows, const uint64_t *t, long n, uint32_t *events, float *tests, float *others);
unsigned long state_bytes(void) { return sizeof(gtm_monitor_state); }
void run(gtm_monitor_state *s, const float *rows, const uint64_t *t, long n, uint32_t *events, float *tests, float *others)
{
    for (long k = 0; k < n; k++) {
        gtm_monitor_sample sample;
        memcpy(&sample, rows + k * GTM_MONITOR_CHANNELS, sizeof sample);
        gtm_monitor_events e = gtm_monitor_update(s, &sample, t[k]);
        const uint32_t told[7] = {e.alarms, e.above, e.possible, e.involved, e.missing, e.flags, e.backlog_rows};
        memcpy(events + 7 * k, told, sizeof told);
        for (unsigned j = 0; j < R; j++) {
            for (unsigned w = 0; tests && w < W; w++) {
                tests[((k * R + j) * W + w) * 2] = gtm_monitor_statistic(s, j, w, 0);
                tests[((k * R + j) * W + w) * 2 + 1] = gtm_monitor_statistic(s, j, w, 1);
            }
            others[(k * R + j) * 3] = gtm_monitor_predicted(s, j);
            others[(k * R + j) * 3 + 1] = gtm_monitor_residual(s, j);
            others[(k * R + j) * 3 + 2] = gtm_monitor_noise_level(s, j);
        }
    }
}
"""


@dataclass
class Told:
    """What the C said, a row a sample."""

    alarms: np.ndarray
    above: np.ndarray
    possible: np.ndarray
    involved: np.ndarray
    missing: np.ndarray
    flags: np.ndarray
    backlog: np.ndarray
    tests: np.ndarray  # (rows, residuals, windows, 2)
    predicted: np.ndarray  # (rows, residuals)
    residuals: np.ndarray
    levels: np.ndarray


class Compiled:
    """An exported folder as a library of this machine; every instance of `begin` is a monitor of its own."""

    def __init__(self, folder, board, *flags, compiler=COMPILER):
        (folder / "driver.c").write_text(_DRIVER)
        command = [compiler, *STRICT, "-O2", "-ffp-contract=off", *flags, "-shared", "-fPIC", "gtm_monitor.c"]
        subprocess.run([*command, "driver.c", "-o", "monitor.so", "-lm"], cwd=folder, check=True)
        self._library = ctypes.CDLL(str(folder / "monitor.so"))
        self._library.state_bytes.restype = ctypes.c_ulong
        self.board = board
        self.state_bytes = int(self._library.state_bytes())

    def begin(self):
        """Return the memory of a monitor that knows nothing."""
        state = ctypes.create_string_buffer(self.state_bytes)
        self._library.gtm_monitor_init(state)
        return state

    def run(self, values, *, times_us=None, state=None, tests=True):
        """Return what a monitor says of rows of the board's channels."""
        board, rows = self.board, np.ascontiguousarray(values, dtype=np.float32)
        period_us = round(board.period_s * 1e6)
        times = np.ascontiguousarray(
            1_000_000 + np.arange(len(rows)) * period_us if times_us is None else times_us, dtype=np.uint64
        )
        residuals, windows = len(board.residuals), len(board.windows)
        events = np.zeros((len(rows), 7), dtype=np.uint32)
        statistics = np.full((len(rows), residuals, windows, 2), np.nan, dtype=np.float32) if tests else None
        others = np.zeros((len(rows), residuals, 3), dtype=np.float32)
        self._library.run(
            state or self.begin(), rows.ctypes, times.ctypes, ctypes.c_long(len(rows)), events.ctypes,
            None if statistics is None else statistics.ctypes, others.ctypes,
        )
        return Told(*events.T.copy(), statistics, *np.moveaxis(others, 2, 0))
