"""How gyros and attitude are installed: what was put into exact kinematics is found, and undone; faults aren't."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.installation.installation import Installation
from gtmbench.detectors.installation.learner import Corrector, Learner, corrected, expected_of
from gtmbench.values.record import Record
from tests.helpers.night import by_day

CHANNELS = ("p", "q", "r", "phi", "theta", "psi")
TURNED = np.array([[1.02, 0.02, -0.01], [0.0, 0.98, 0.03], [-0.02, 0.0, 1.01]])


def angles(time_s, seed):
    """Return bank, pitch and a heading that runs on, smooth, and their rates, in deg and deg/s."""
    random = np.random.default_rng(seed)
    rate, phase = random.uniform(1.0, 8.0, (3, 6)), random.uniform(0.0, 2.0 * np.pi, (3, 6))
    size = np.array([20.0, 8.0, 15.0])[:, np.newaxis] / rate
    turns = rate[..., np.newaxis] * time_s + phase[..., np.newaxis]
    values = np.einsum("ij,ijk->ki", size, np.sin(turns)) + np.outer(time_s, [0.0, 0.0, 3.0])
    rates = np.einsum("ij,ijk->ki", size * rate, np.cos(turns))
    return values, rates + np.array([0.0, 0.0, 3.0])


def flown(duration_s=100.0, *, rate_hz=50.0, seed=1, gyros=None, bias=0.0, late_s=0.0, drift=0.0, noise=1.0):
    """Return exact kinematics, read by gyros and an attitude that are installed so."""
    time_s = np.arange(round(duration_s * rate_hz)) / rate_hz
    (phi, theta, _), (phi_rate, theta_rate, psi_rate) = (each.T for each in angles(time_s, seed))
    a, b = np.deg2rad(phi), np.deg2rad(theta)
    rates = np.column_stack(
        [
            phi_rate - psi_rate * np.sin(b),
            theta_rate * np.cos(a) + psi_rate * np.cos(b) * np.sin(a),
            psi_rate * np.cos(b) * np.cos(a) - theta_rate * np.sin(a),
        ]
    )
    read = rates @ (np.eye(3) if gyros is None else gyros).T + bias
    attitude, _ = angles(time_s - late_s - drift * time_s, seed)
    attitude[:, 2] = (attitude[:, 2] + 180.0) % 360.0 - 180.0
    own = np.random.default_rng(seed).standard_normal((len(time_s), 6)) * ([0.3] * 3 + [0.02] * 3)
    values = np.column_stack([read, attitude]) + noise * own
    return Record(values, channels=CHANNELS, sample_period_s=1.0 / rate_hz)


def left_of(record):
    """Return the RMS of gyros less the attitude's rates, slow enough for the attitude's noise."""
    derived = gb.derive(record, ["p_att", "q_att", "r_att"])
    left = np.column_stack([derived[name] - derived[f"{name}_att"] for name in "pqr"])
    there = np.isfinite(left).all(axis=1)
    smooth = [np.convolve(column[there], np.ones(8) / 8.0, mode="valid") for column in left.T]
    return np.std(smooth, axis=1)


@pytest.mark.parametrize("rate_hz", by_day([25.0, 100.0]))
@pytest.mark.parametrize(("late_s", "drift"), [(0.0, 0.0), (0.005, 0.0), (0.04, 3e-4), (-0.03, -3e-4)])
def test_what_was_installed_is_found_and_undone(late_s, drift, rate_hz):
    record = flown(rate_hz=rate_hz, gyros=TURNED, bias=0.5, late_s=late_s, drift=drift)
    (undone,), found = corrected([record])
    np.testing.assert_allclose(found.gyros, TURNED, atol=0.004)
    np.testing.assert_allclose(found.bias, 0.5, atol=0.05)
    at = np.array([0.0, 50.0, 100.0])
    np.testing.assert_allclose(found.late_at(at), late_s + drift * at, atol=0.0008)
    assert (left_of(undone) < 1.15 * left_of(flown(rate_hz=rate_hz))).all()
    assert (left_of(record) > 1.3 * left_of(flown(rate_hz=rate_hz))).any()
    assert np.isfinite(undone.values).all(axis=1).mean() > 0.995


def test_what_is_installed_plainly_stays_bit_for_bit():
    record = flown()
    (same,), found = corrected([record])
    assert found.is_plain
    assert found.said == ()
    np.testing.assert_array_equal(same.values, record.values)


def test_at_rest_nothing_is_undone():
    noise = np.random.default_rng(1).standard_normal((5000, 6)) * ([0.3] * 3 + [0.02] * 3)
    record = Record(noise, channels=CHANNELS, sample_period_s=0.02)
    assert corrected([record])[1].is_plain


def test_pieces_of_a_stream_say_what_the_record_does():
    record = flown(gyros=TURNED, late_s=0.02, drift=2e-4)
    (whole,), _ = corrected([record])
    corrector = Corrector(Learner(record.sample_period_s))
    parts, begin = [], 0
    for size in np.random.default_rng(2).integers(1, 400, 60):
        parts += corrector.push(record.part(range(begin, min(begin + int(size), len(record)))))
        begin = min(begin + int(size), len(record))
        if begin == len(record):
            break
    parts += corrector.end()
    np.testing.assert_allclose(np.concatenate([part.values for part in parts]), whole.values, atol=1e-9)


def test_nothing_that_comes_later_changes_what_was_said():
    record = flown(gyros=TURNED, late_s=0.02, drift=2e-4)
    whole, cut = (corrected([each])[0][0] for each in (record, record.between(0.0, 61.0)))
    np.testing.assert_array_equal(cut.values, whole.values[: len(cut)])


@pytest.mark.parametrize(
    "fault",
    [
        gb.ScaleFactor(channel="p", onset_s=50.0, factor=0.8),
        gb.Jam(channel="q", onset_s=50.0),
        gb.Drift(channel="r", onset_s=50.0, slope=0.2),
        gb.Oscillation(channel="p", onset_s=50.0, amplitude=2.0, frequency_hz=1.0),
    ],
    ids=lambda fault: type(fault).__name__,
)
def test_a_fault_that_begins_later_is_not_learnt(fault):
    record = flown(gyros=TURNED, late_s=0.02)
    found = corrected([gb.inject(record, fault)])[1]
    np.testing.assert_allclose(found.gyros, TURNED, atol=0.004)
    assert found.late_s == pytest.approx(0.02, abs=0.001)


def test_a_gyro_that_no_healthy_one_is_like_stays_and_hides_no_lag():
    record = gb.inject(flown(late_s=0.02), gb.Jam(channel="p", onset_s=0.0))
    (undone,), found = corrected([record])
    assert found.late_s == pytest.approx(0.02, abs=0.001)
    np.testing.assert_array_equal(found.gyros[0], [1.0, 0.0, 0.0])
    np.testing.assert_allclose(undone["p"][10:], record["p"][10], atol=1e-9)


def test_a_stretch_too_short_is_left_and_the_next_goes_on():
    record = flown(late_s=0.02)
    parts = [record.between(0.0, 4.0), record.between(10.0, 60.0)]
    (first, second), found = corrected(parts)
    np.testing.assert_array_equal(first.values, parts[0].values)
    assert found.late_s == pytest.approx(0.02, abs=0.001)
    assert (left_of(second) < 1.15 * left_of(flown())).all()


@pytest.fixture(scope="module")
def monitor():
    records = [flown(140.0, seed=seed, late_s=0.01) for seed in (11, 12, 13, 14, 15, 16)]
    return gb.calibrate(records, bank=gb.load_bank("C"))


def test_a_monitors_own_installation_is_what_it_expects(monitor):
    expected = expected_of(monitor)
    assert expected.late_s == pytest.approx(0.01, abs=0.001)
    np.testing.assert_allclose(expected.gyros, np.eye(3), atol=1e-6)
    assert corrected([flown(late_s=0.01, seed=3)], expected)[1].is_plain


def test_a_healthy_log_that_is_installed_otherwise_is_healthy_and_says_how(monitor, tmp_path):
    gb.write_log(flown(150.0, seed=21, gyros=TURNED, late_s=0.04, drift=1e-4), tmp_path / "other.parquet")
    watched = gb.watch_log(tmp_path / "other.parquet", monitor)
    assert watched.outcome is gb.Outcome.HEALTHY
    assert isinstance(watched.installation, Installation)
    assert "attitude 30 ms late" in watched.reasons[0]
    assert "q reads 2." in watched.reasons[0]
    np.testing.assert_allclose(watched.installation.gyros, TURNED, atol=0.004)


@pytest.mark.nightly
def test_a_fault_of_such_a_log_is_found_live_and_as_a_whole(monitor, tmp_path):
    record = flown(150.0, seed=21, gyros=TURNED, late_s=0.04, drift=1e-4)
    broken = gb.inject(record, gb.Bias(channel="q", onset_s=90.0, size=3.0))
    gb.write_log(broken, tmp_path / "broken.parquet")
    (alarm,) = gb.watch_log(tmp_path / "broken.parquet", monitor).alarms
    assert alarm.sensor == "q"
    assert 90.0 < alarm.time_s < 92.0
    told = [each for piece in gb.watch_live(tmp_path / "broken.parquet", monitor) for each in piece]
    assert {each.time_s for each in told} == {alarm.time_s}
    assert told[-1].sensor == "q"
