"""How much of a log is known on a monitor's clock, by the log's rate and by what befell its stamps.

    python experiments/lost_samples.py [--quick] [--out DIR]

A flight of the GTM with the T2's noise is sampled as a logger would: attitude and gyros at stamps of their own, even,
or with a jitter of a tenth of a period (deviation; half a period at most), every fiftieth sample of either lost, or
every fiftieth row of both. `open_log` brings it to 100 Hz, a slower log to its own rate. Told are the share of the
flight's rows that lack no channel, and the processor's time to open it; of even logs at their own rate also how many of
the lost samples were told by their neighbours, and how wrong. Writes report.md and rows.csv into DIR.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

import gtmbench as gb
from gtmbench.files.folders import atomic_folder
from gtmbench.values.channels import header_of
from studies.conduct import write_report

CHANNELS = ("phi", "theta", "psi", "p", "q", "r")
RATES_HZ = (10, 25, 50, 100, 125, 200, 250, 400, 1000)
KINDS = {  # jitter, what is lost, of which
    "even": (0.0, 0.0, False),
    "jitter": (0.1, 0.0, False),
    "2 % lost": (0.0, 0.02, False),
    "jitter, 2 % lost": (0.1, 0.02, False),
    "jitter, 2 % of rows lost": (0.1, 0.02, True),
}
FASTEST_HZ, DURATION_S = 100.0, 130.0
AGAIN = 3  # times opened, of which the fastest counts


def logged(true: CubicSpline, noise: np.ndarray, rate_hz: float, kind: str) -> pd.DataFrame:
    """Return a table of the attitude and the gyros, empty where one has no sample."""
    jitter, loss, together = KINDS[kind]
    rng = np.random.default_rng([int(rate_hz), *kind.encode()])
    count = int((true.x[-1] - 0.5) * rate_hz)
    sensors = [CHANNELS] if together else [CHANNELS[:3], CHANNELS[3:]]
    tables = []
    for sensor in sensors:
        off = np.clip(jitter * rng.standard_normal(count), -0.5, 0.5)
        time_s = np.sort(0.0037 + (np.arange(count) + off) / rate_hz)[rng.random(count) >= loss]
        columns = [CHANNELS.index(name) for name in sensor]
        read = true(time_s)[:, columns] + noise[columns] * rng.standard_normal((len(time_s), len(columns)))
        tables.append(pd.DataFrame(read, columns=[header_of(name) for name in sensor]).assign(time_s=time_s))
    return pd.concat(tables).sort_values("time_s", kind="stable")


def opened(path: Path, rate_hz: float) -> tuple[float, float]:
    """Return the share of a flight's rows that lack nothing, and the seconds that opening takes."""
    taken_s = np.inf
    for _ in range(AGAIN):
        began_s = time.process_time()
        log = gb.open_log(path, needs=CHANNELS, rate_hz=rate_hz)
        taken_s = min(taken_s, time.process_time() - began_s)
    known_s = sum(np.isfinite(each.values).all(axis=1).sum() * each.sample_period_s for each in log.segments)
    return known_s / (DURATION_S - 0.5), taken_s


def told(true: CubicSpline, noise: np.ndarray, path: Path, rate_hz: float) -> tuple[float, float, float]:
    """Return the share of lost samples that were told, and the least and greatest channel's error, of the noise's."""
    table = logged(true, noise, rate_hz, "2 % lost")
    (record,) = gb.open_log(path, needs=CHANNELS, rate_hz=rate_hz).segments
    shares, errors = [], []
    for place, name in enumerate(CHANNELS):
        read_s = table["time_s"][np.isfinite(table[header_of(name)])].to_numpy()
        lost = np.abs(record.time_s[:, np.newaxis] - read_s[np.newaxis]).min(axis=1) > 0.1 * record.sample_period_s
        error = (record[name] - true(record.time_s)[:, place])[lost] / noise[place]
        shares.append(np.isfinite(error).mean())
        errors.append(np.sqrt(np.nanmean(error**2)) if np.isfinite(error).any() else np.nan)
    return float(np.mean(shares)), float(np.min(errors)), float(np.max(errors))


def main() -> None:
    """Fly, write logs, open them, and tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="three rates only")
    parser.add_argument("--out", type=Path, help="a folder for report.md and rows.csv")
    given = parser.parse_args()
    flight = gb.fly("gtm", "multisine+turbulence", DURATION_S, 811)
    values = flight.matrix(CHANNELS)
    noise = np.diff(gb.measure(flight, noise="t2", seed=811).matrix(CHANNELS) - values, axis=0).std(axis=0) / np.sqrt(2)
    true = CubicSpline(flight.time_s, values)
    rows, laid = [], []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "flight.parquet")
        for rate_hz in (50, 125, 200) if given.quick else RATES_HZ:
            for kind in KINDS:
                logged(true, noise, rate_hz, kind).to_parquet(path, index=False)
                rows.append((rate_hz, kind, *opened(path, min(rate_hz, FASTEST_HZ))))
                if kind == "2 % lost" and rate_hz <= FASTEST_HZ:
                    share, least, most = told(true, noise, path, rate_hz)
                    error = f"{least:.2f} to {most:.2f}" if share else "-"
                    laid.append(f"| {rate_hz} | {100 * share:.0f} % | {error} |")
    table = pd.DataFrame(rows, columns=["rate_hz", "kind", "known", "open_s"])
    lines = ["# Lost samples", "", "Rows that lack no channel, % of the flight (processor's ms to open it)", ""]
    lines += [f"| Hz | {' | '.join(KINDS)} |", "|---:|" + "---:|" * len(KINDS)]
    for rate_hz, of_rate in table.groupby("rate_hz"):
        cells = [f"{100 * row.known:.1f} ({1e3 * row.open_s:.0f})" for row in of_rate.itertuples()]
        lines.append(f"| {rate_hz} | {' | '.join(cells)} |")
    lines += [
        "",
        "Samples that an even log lost: told by their neighbours; the error's RMS, of the noise's deviation",
        "",
    ]
    lines += ["| Hz | told | error, by channel |", "|---:|---:|---:|", *laid]
    print("\n".join(lines))
    if given.out:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        with atomic_folder(given.out) as folder:
            write_report(folder, "\n".join(lines) + "\n", given)
            table.to_csv(folder / "rows.csv", index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
