"""The study of slow faults in recorded flights: what it counts, and that nobody healthy is named."""

import pandas as pd
import pytest

import gtmbench as gb
import slow_faults_in_logs as study


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """Return what is said of a written flight, as it is and with a bias of each gyro."""
    (path,) = study.synthetic(tmp_path_factory.mktemp("logs"), range(66_001, 66_002))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "faults", one_fault)
        return pd.DataFrame(study.cases(path))


def one_fault(sensor, onset_s, _left_s, sign):
    yield "bias 2 deg/s", gb.Bias(channel=sensor, onset_s=onset_s, size=2.0 * sign)


def test_nobody_healthy_is_named_and_witnesses_name_more(rows):
    clean, put = rows[rows["fault"] == ""], rows[rows["fault"] != ""]
    assert clean["said"].tolist() == ["HEALTHY"]
    assert put["sensor"].tolist() == ["p", "q", "r"]
    assert not put["said"].eq(study.WRONG).any()
    assert (put["said"] == study.NAMED).sum() >= max((put["without"] == study.NAMED).sum(), 2)


def test_the_report_counts_every_fault_once(rows):
    sums, *_ = study.report(rows)[1:]
    assert "| all " in sums
    assert int(study._sums(rows[rows["fault"] != ""])["put"]) == 3


def test_a_drift_reaches_its_size_within_what_is_left():
    (_, short), (_, long) = (list(study.faults("p", 10.0, left_s, -1.0))[-1] for left_s in (30.0, 300.0))
    assert (short.slope, long.slope) == (-0.1, -0.05)


def test_a_log_that_cant_be_watched_is_a_row(tmp_path):
    (tmp_path / "log.csv").write_text("time_s,p\n0,1\n1,2\n")
    (row,) = study.cases(tmp_path / "log.csv")
    assert row["said"] == "refused"
