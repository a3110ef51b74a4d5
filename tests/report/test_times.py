"""Times as the log has them: seconds on its clock, beside them hours, and UTC where its stamps are dates."""

import json
import re

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from gtmbench.report.words.verdict import labelled

BEGAN = 1_714_564_800.25  # 2024-05-01 12:00:00.250 UTC


@pytest.fixture(scope="module")
def frame():
    """Return a minute of two channels, the second of which breaks."""
    noise = np.random.default_rng(1).standard_normal((3000, 2))
    record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    return gb.inject(record, gb.Noise(channel="q", onset_s=80.0, deviation=3.0)).frame().reset_index()


def watched(frame, path, stamps):
    pd.DataFrame({"time_s": stamps, "p_deg_s": frame["p"], "q_deg_s": frame["q"]}).to_csv(path, index=False)
    return gb.watch_log(path, gb.bank_between(["p"], ["q"]), healthy=[(0.0, 40.0)])


def test_stamps_since_1970_are_told_as_dates(frame, tmp_path):
    found = watched(frame, tmp_path / "flight.csv", BEGAN + 0.04 * np.arange(3000))
    assert f"{found.log.zero_utc}" == "2024-05-01T12:00:00.250"
    told = dict(labelled(found))["When"]
    assert told.endswith(" UTC.")
    again = gb.open_log(tmp_path / "flight.csv")
    assert again.zero_utc == found.log.zero_utc


def test_a_clock_since_boot_has_no_date(frame, tmp_path):
    found = watched(frame, tmp_path / "flight.csv", 0.04 * np.arange(3000))
    assert found.log.zero_utc is None
    assert "When" not in dict(labelled(found))


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
    assert json.loads(cli("monitor", "late.csv", "--json")[1])["log"]["zero_utc"] is None
    pd.DataFrame({"time_s": BEGAN + 0.01 * np.arange(len(table)), **columns}).to_csv("dated.csv", index=False)
    printed = " ".join(cli("monitor", "dated.csv")[1].split())
    assert re.search(r"When (39|40)\.\d s is 2024-05-01 12:00:(39|40)\.\d UTC\.", printed)
    assert json.loads(cli("monitor", "dated.csv", "--json")[1])["log"]["zero_utc"] == "2024-05-01T12:00:00.250Z"
