"""The study of wrong scales in recorded flights: what it counts, and that nobody healthy is named."""

import pandas as pd
import pytest

import gtmbench as gb
import wrong_scales_in_logs as study


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """Return what is said of a written flight, as it is and with a turned sign of r."""
    (path,) = study.synthetic(tmp_path_factory.mktemp("logs"), range(66_003, 66_004))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "faults", one_fault)
        patch.setattr(study, "GYROS", ("r",))
        return pd.DataFrame(study.cases(path))


def one_fault(sensor, onset_s):
    yield "turned sign", gb.SignFlip(channel=sensor, onset_s=onset_s)


def test_the_broken_gyro_is_named_and_nobody_healthy(rows):
    clean, put = rows[rows["fault"] == ""], rows[rows["fault"] != ""]
    assert clean["said"].tolist() == ["HEALTHY"]
    assert put["said"].tolist() == [study.NAMED]


def test_the_report_counts_every_fault_once(rows):
    put = rows[rows["fault"] != ""]
    by_fault, by_time_constant = study.report(rows)[1:3]
    assert "| all " in by_fault
    assert "time constant" in by_time_constant
    assert int(study._sums(put)["put"]) == len(put)


def test_a_fault_of_each_scale_and_a_turned_sign_are_put():
    kinds = [(name, type(fault)) for name, fault in study.faults("q", 12.0)]
    assert [name for name, _ in kinds] == ["scale 0.5", "scale 0.7", "scale 1.5", "turned sign"]
    assert {kind for _, kind in kinds} == {gb.ScaleFactor, gb.SignFlip}


def test_a_log_that_cant_be_watched_is_a_row(tmp_path):
    (tmp_path / "log.csv").write_text("time_s,p\n0,1\n1,2\n")
    (row,) = study.cases(tmp_path / "log.csv")
    assert row["said"] == "refused"
