"""Times as the log has them: seconds on its clock, beside them hours and its own stamps, UTC where that is known."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.report.words.units import round_times, stamp_text
from gtmbench.report.words.verdict import labelled
from tests.helpers.night import by_day

BEGAN = 1_714_564_800.25  # 2024-05-01 12:00:00.250 UTC


@pytest.fixture(scope="module")
def frame():
    """Return a minute of two channels, the second of which breaks."""
    noise = np.random.default_rng(1).standard_normal((3000, 2))
    record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    return gb.inject(record, gb.Noise(channel="q", onset_s=80.0, deviation=3.0)).frame().reset_index()


def watched(frame, path, stamps):
    pd.DataFrame({"time_s": stamps, "p_deg_s": frame["p"], "q_deg_s": frame["q"]}).to_csv(path, index=False)
    log = gb.open_log(path)
    start_s = log.segments[0].start_s
    return gb.watch_log(path, gb.bank_between(["p"], ["q"]), healthy=[(start_s, start_s + 40.0)])


def test_stamps_since_1970_are_told_as_dates(frame, tmp_path):
    found = watched(frame, tmp_path / "flight.csv", BEGAN + 0.04 * np.arange(3000))
    assert f"{found.log.zero_utc}" == "2024-05-01T12:00:00.250"
    told = dict(labelled(found))["When"]
    assert told.endswith(" UTC.")
    again = gb.open_log(tmp_path / "flight.csv")
    assert again.zero_utc == found.log.zero_utc


@pytest.mark.parametrize(
    ("written", "zero", "utc"),
    by_day(
        [
            ("%Y-%m-%d %H:%M:%S.%f", "2026-05-04 23:59:10.020", None),
            ("%Y-%m-%dT%H:%M:%S.%fZ", "2026-05-04 23:59:10.020 UTC", "2026-05-04T23:59:10.020"),
            ("%Y-%m-%d %H:%M:%S.%f+02:00", "2026-05-04 21:59:10.020 UTC", "2026-05-04T21:59:10.020"),
            ("%d.%m.%Y %H:%M:%S.%f", "2026-05-04 23:59:10.020", None),
            ("%H:%M:%S.%f", "23:59:10.020", None),
            ("%d/%m/%Y %H:%M:%S.%f", "2026-05-04 23:59:10.020", None),  # which is its day is told by midnight
        ],
        3,
    ),
)
def test_stamps_are_told_as_the_log_writes_them_and_as_utc_only_where_they_say_so(frame, tmp_path, written, zero, utc):
    began = pd.Timestamp("2026-05-04 23:59:10.020")
    stamps = [(began + pd.Timedelta(seconds=0.04 * k)).strftime(written) for k in range(3000)]
    log = watched(frame, tmp_path / "flight.csv", stamps).log
    assert log.zero_stamp == zero
    assert (None if log.zero_utc is None else str(log.zero_utc)) == utc
    assert stamp_text(log.zero_stamp, 60.04).partition(" UTC")[0].endswith(":00:10.0")


def test_a_date_beside_the_column_that_tells_the_time_is_no_date_of_it(frame, tmp_path):
    """A logger's clock runs since boot, and GPS writes when it was in a column of its own."""
    boot_s = 500.0 + 0.04 * np.arange(3000)
    gps = [f"2026-05-04 11:59:{10 + k // 1000:02d}.000" for k in range(3000)]
    columns = {"time_s": boot_s, "gps_utc": gps, "p_deg_s": frame["p"], "q_deg_s": frame["q"]}
    pd.DataFrame(columns).to_csv(tmp_path / "flight.csv", index=False)
    log = gb.open_log(tmp_path / "flight.csv")
    assert (log.segments[0].start_s, log.zero_stamp, log.zero_utc) == (500.0, "", None)


@given(st.floats(0.0, 9e4), st.floats(0.1, 9e4))
def test_round_times_lie_within_and_say_when_they_are(start_s, length_s):
    span = (start_s, start_s + length_s)
    ticks = round_times(span)
    assert 2 <= len(ticks) <= 9
    assert all(span[0] - 1e-6 <= time_s <= span[1] + 1e-6 for time_s, _ in ticks)
    for time_s, name in ticks:
        parts = [float(part) for part in name.split(":")]
        assert sum(part * 60.0**place for place, part in enumerate(reversed(parts))) == pytest.approx(time_s, abs=0.06)
        assert (len(parts) == 3) == (span[1] >= 3600.0)


def test_a_clock_since_boot_has_no_date(frame, tmp_path):
    found = watched(frame, tmp_path / "flight.csv", 0.04 * np.arange(3000))
    assert (found.log.zero_stamp, found.log.zero_utc) == ("", None)
    assert "When" not in dict(labelled(found))


@pytest.mark.nightly
def test_beyond_an_hour_hours_stand_beside_seconds_and_json_has_the_date(tmp_path, cli, monkeypatch):
    monkeypatch.chdir(tmp_path)
    broken = gb.measure(gb.fly(excitation="multisine+turbulence", duration_s=60, seed=3), noise="t2", seed=3)
    table = gb.inject(broken, gb.Bias(channel="q", onset_s=40.0, size=5.0)).frame().reset_index()
    names = ("p", "q", "r", "phi", "theta", "psi")
    columns = {f"{name}_deg{'_s' * (name in 'pqr')}": table[name] for name in names}
    pd.DataFrame({"time_s": 5000.0 + 0.01 * np.arange(len(table)), **columns}).to_csv("late.csv", index=False)
    code, out, _ = cli("monitor", "late.csv")
    assert code == 1
    assert "failed from 5040." in out
    assert "s (1:24:00) on" in " ".join(out.split())
    assert "failed 1:24:00." in out
    assert re.search(r"When +5040\.\d s \(1:24:00\) is 40\.\d s after the first sample\.", out)
    assert json.loads(cli("monitor", "late.csv", "--json")[1])["log"]["zero_utc"] is None
    pd.DataFrame({"time_s": BEGAN + 0.01 * np.arange(len(table)), **columns}).to_csv("dated.csv", index=False)
    printed = " ".join(cli("monitor", "dated.csv")[1].split())
    assert re.search(r"When (39|40)\.\d s is 2024-05-01 12:00:(39|40)\.\d UTC\.", printed)
    told = json.loads(cli("monitor", "dated.csv", "--json")[1])
    assert told["log"]["zero_utc"] == "2024-05-01T12:00:00.250Z"
    (failed,) = (span for span in told["timeline"]["sensors"]["q"] if span["state"] == "failed")
    assert re.fullmatch(r"2024-05-01 12:00:(39|40)\.\d{3} UTC", failed["start_stamp"])
