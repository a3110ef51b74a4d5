"""The study of the engine on logs: which logs it takes, which faults it puts, what of a timeline counts."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import engine_on_logs as study
import gtmbench as gb
from gtmbench.verdict.timeline import SensorSpan, Sizes, State, unjudged

CLEAR = SensorSpan(
    start_s=0.0, end_s=100.0, state=State.CLEAR, sizes=Sizes(error=2.0, within_s=60.0, factors=(0.5, 2.0))
)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """Return how a quick run ended, and its folder."""
    out = tmp_path_factory.mktemp("quick") / "report"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OPENBLAS_NUM_THREADS", "1")  # which the script sets
        patch.setattr(sys, "argv", [study.__file__, "--quick", "--out", str(out)])
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(study.__file__, run_name="__main__")
    return ended.value.code, out


def log(name, folder="logs"):
    return study.Log(Path(folder, name), study.REAL, 2, 1)


def put(kind, **given):
    usual = {"gyro": "q", "attitude": "alone", "sign": -1.0, "onset_s": 50.0, "left_s": 70.0}
    return study.Put(kind, **(usual | given))


@pytest.mark.nightly
def test_a_quick_run_prints_its_tables_and_misses_nothing(quick):
    code, out = quick
    assert code == 0
    said = (out / "report.md").read_text()
    for line in (study.SAID_QUICK, "| simulated: faults inside ", "| simulated | later |", "## Healthy logs that are"):
        assert line in said


@pytest.mark.nightly
def test_a_log_has_a_row_and_a_fault_has_one(quick):
    logs, faults = (pd.read_csv(quick[1] / f"{name}.csv", keep_default_na=False) for name in ("logs", "faults"))
    assert (len(logs), len(faults)) == (1, 2)
    assert logs["named"].tolist() == [""]
    assert logs[["p clear", "q clear", "r clear"]].stack().between(0.5, 1.0).all()
    assert logs["minutes"].between(1.9, 2.0).all()
    assert set(faults["said"]) <= {study.RIGHT, study.EITHER_OR, study.CANT_TELL, study.NOTHING}
    assert faults["onset_s"].between(3.0, 100.0).all()
    assert not faults["inside"].any()
    assert (faults["right"] == (faults["said"] == study.RIGHT)).all()


@pytest.mark.parametrize(
    ("kind", "is_promised"),
    [("bias 1 deg/s", False), ("bias 2 deg/s", True), ("scale 0.6", False), ("sign", True), ("jam", True)],
)
def test_a_fault_of_the_stated_size_is_promised(kind, is_promised):
    assert put(kind).is_promised(CLEAR) is is_promised
    assert not put(kind).is_promised(unjudged((0.0, 100.0), "something changed"))


@pytest.mark.parametrize(
    ("kind", "size"), [("bias 5 deg/s", -5.0), ("drift 0.5 deg/s2", -0.5), ("sign", 2.0), ("scale 0.6", -2.0 / 3.0)]
)
def test_a_size_is_that_of_findings(kind, size):
    assert put(kind).size == pytest.approx(size)
    read = np.array([3.0, 7.0])
    record = gb.Record(read, channels=["q"], sample_period_s=1.0)
    if put(kind).calls == study.SCALE:
        wrong = study.broken(record, put(kind, onset_s=0.0))["q"]
        assert (wrong - read).tolist() == pytest.approx((size * wrong).tolist())


def test_what_isnt_a_flight_is_left_out(tmp_path):
    (tmp_path / "notes.csv").write_text("nothing that flies\n")
    assert study.left_out(log("notes.csv", tmp_path)) == "without gyros and attitude"
    still = gb.Record(np.zeros((700, 6)), channels=study.CHANNELS, sample_period_s=0.1)
    gb.write_log(still, tmp_path / "still.csv")
    assert study.left_out(log("still.csv", tmp_path)) == "without motion"
    gb.write_log(still.between(0.0, 20.0), tmp_path / "short.csv")
    assert study.left_out(log("short.csv", tmp_path)) == "too short"
