"""The pictures of README, site and guides, drawn anew: ``make pictures``, or ``python experiments/pictures.py``.

What commands write is taken from them (`gtmbench run`, `gtmbench fly --rescue`); the log's figure and its page are
those of a flight with a gap and a gyro that is broken. The page is seen by the browser that the tests have; without one
it stays as it is, and so do the tabs of the rerun viewer, which are taken by hand. A few minutes on one core.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import gtmbench as gb
from gtmbench.files.writing import atomic_write
from gtmbench.report.figures.log import write_log_figure
from gtmbench.report.page.flight import flight_page

OUT = Path(__file__).parent / "pictures"
DURATION_S, SEED, ONSET_S = 120.0, 4, 90.0
GAP_S = (50.0, 53.5)
FAULTS: dict[str, gb.Fault] = {
    "log": gb.Deadzone(channel="q", onset_s=ONSET_S, half_width=3.0),
    "page": gb.Bias(channel="q", onset_s=ONSET_S, size=3.0),
}
WRITTEN = {  # by commands: what of it is shown, and as what
    "run jam --detector C --out jam": ("jam/virtual_jam.png", "virtual_jam.png"),
    "run drift --out drift": ("drift/norm_drift.png", "norm_drift.png"),
    "fly --rescue --figure rescue.png": ("rescue.png", "rescue.png"),
}
BESIDE = {"run drift --out drift": ("drift/markov.png", "markov.png")}
BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
SEEN = (1100, 1000)  # pixels of the page


def by_commands(folder: Path, out: Path) -> None:
    """Run commands in a folder, and keep the figures that they write."""
    for command, (made, name) in WRITTEN.items():
        print(f"gtmbench {command}", flush=True)
        subprocess.run([sys.executable, "-m", "gtmbench", *command.split(), "-q"], cwd=folder, check=True)
        for source, target in ((made, name), BESIDE.get(command, (made, name))):
            shutil.copyfile(folder / source, out / target)


def broken_log(folder: Path, name: str) -> Path:
    """Write a log with a gap and a broken gyro; return where."""
    flight = gb.fly(excitation="multisine+turbulence", duration_s=DURATION_S, seed=SEED)
    broken = gb.inject(gb.measure(flight, noise="t2", seed=SEED), FAULTS[name])
    path = folder / f"{name}.csv"
    gb.write_log(broken, path)
    header, *rows = path.read_text().splitlines(keepends=True)
    times_s = np.array([float(row.partition(",")[0]) for row in rows])
    kept = (times_s < GAP_S[0]) | (times_s > GAP_S[1])
    path.write_text(header + "".join(row for row, is_kept in zip(rows, kept, strict=True) if is_kept))
    return path


def of_logs(folder: Path, out: Path) -> None:
    """Draw a watched log, and what a browser shows of another one's page."""
    with atomic_write(out / "log.png") as aside:
        write_log_figure(gb.watch_log(broken_log(folder, "log"), "auto", healthy=[(0.0, 25.0)]), aside)
    page = folder / "page.html"
    watched = gb.watch_log(broken_log(folder, "page"), "auto", healthy=[(0.0, 25.0)])
    page.write_text(flight_page(watched, "gtmbench monitor page.csv --report page.html"), encoding="utf-8")
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        print("page.png stays as it is: no browser here (Debian: chromium-headless-shell)")
        return
    from playwright.sync_api import sync_playwright

    with sync_playwright() as player:
        opened = player.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        tab = opened.new_page(viewport={"width": SEEN[0], "height": SEEN[1]})
        tab.goto(page.as_uri())
        tab.screenshot(path=out / "page.png")
        opened.close()


def main() -> None:
    """Draw them into the folder that is asked for."""
    parser = argparse.ArgumentParser(description="Draw the pictures of README, site and guides.")
    parser.add_argument("--out", type=Path, default=OUT)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        of_logs(Path(name), out)
        by_commands(Path(name), out)
    print(f"pictures: {out}; orders.png is that of choices.py, viewer*.png and decision.png are the viewer's, by hand")


if __name__ == "__main__":
    main()
