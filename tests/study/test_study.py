"""The whole chain, from trim to verdicts, on the dissertation's study."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.study.run import run_study
from gtmbench.study.scenario import load_scenario
from tests.helpers.night import by_day
from tests.helpers.watching import SHIPPED, dissertation


@pytest.fixture(params=by_day([1, 2]))
def study(request):
    return dissertation(request.param)


def test_all_fifteen_faults_are_detected_without_a_false_alarm(study):
    assert len(study.trials) == 15
    assert {(trial.fault, trial.channel) for trial in study.trials} == {(kind, c) for kind in SHIPPED for c in "pqr"}
    assert all(trial.detected for trial in study.trials), [trial.reason for trial in study.trials]
    assert study.baseline.false_alarms == 0
    assert study.baseline.healthy_hours > 0.5


def test_delays_are_those_of_the_prototype(study):
    """A slow drift of p takes minutes, of q a quarter of one; all else is found within a window or so."""
    delays = {(trial.fault, trial.channel): trial.detection_delay_s for trial in study.trials}
    assert delays.pop(("drift", "p")) == pytest.approx(delay_by_superposition_s(study, "p", slope=0.05), abs=1e-6)
    assert 10.0 < delays.pop(("drift", "q")) < 40.0
    assert max(delays.values()) < 10.0


def delay_by_superposition_s(study, channel, slope):
    """Return when a drift from 300 s on is found: residuals are linear, so its own adds to the healthy record's.

    Of p the operator passes a fiftieth at 0 Hz, so this is minutes, and how many hangs on the noise.
    """
    base = study.baseline
    operator, time_s = base.monitor.operator, base.watch.record.time_s
    markov = operator.markov[:, 0, operator.inputs.index(channel)]
    passed = np.convolve(slope * np.maximum(time_s - 300.0, 0.0), markov)[operator.noncausal_order :][: len(time_s)]
    squares = np.nancumsum((base.watch.residuals["r"] - passed) ** 2)
    norm = np.sqrt(squares[1001:] - squares[:-1001])  # of 1001 samples; E(k) knows the last half a second later
    above = (norm > base.monitor.threshold) & (time_s[1001:] > 300.0)
    return time_s[1001:][np.argmax(above)] + 0.5 - 300.0


def test_every_number_follows_from_the_public_functions_and_the_definitions():
    """The study again, step by step, without `gtmbench.study`: section 4.4 from the front door."""
    flight = gb.fly(aircraft="gtm", excitation="dissertation", duration_s=500, seed=1)
    healthy = [gb.measure(flight, snr=50, seed=seed) for seed in (1, 1001, 2001)]
    operator = gb.identify(
        healthy[0].between(25, 200), inputs=["p", "q", "beta"], outputs=["r"], causal_order=50, noncausal_order=50
    )
    assert operator.samples == 17_501 - 100
    norm = gb.windowed_norm(gb.residual(operator, healthy[1]), window=1000)
    limit = 1.5 * max(norm.values[20_000:48_001])

    truth = flight["p"][2_500:30_001]
    half_width = 0.5 * np.sqrt(np.mean((truth - truth.mean()) ** 2))
    broken = gb.inject(healthy[2], gb.Deadzone(channel="p", onset_s=300, half_width=half_width))
    norm = gb.windowed_norm(gb.residual(operator, broken.between(25, 500)), window=1000).values  # from 25 s on
    watched = np.concatenate([np.full(2_500, np.nan), norm])
    above = watched > limit
    first = next(k for k in range(2_551, 49_000) if above[k] and not above[k - 1] and k + 1000 + 50 >= 30_000)

    trial = next(trial for trial in gb.run("faults/deadzone.toml") if trial.channel == "p")
    assert trial.baseline.monitor.threshold == pytest.approx(limit, rel=1e-12)
    assert trial.severity["half_width"] == pytest.approx(half_width, rel=1e-12)
    assert trial.alarm_time_s == pytest.approx((first + 1000 + 50) * 0.01, abs=1e-9)
    assert trial.detection_delay_s == pytest.approx(trial.alarm_time_s - 300.0, abs=1e-9)
    assert (trial.look_ahead_s, trial.baseline.monitor.window_s) == (0.5, 10.01)
    peak = np.nanmax(watched[30_000 - 1050 :])
    assert trial.peak_ratio == pytest.approx(peak / limit, rel=1e-12)
    assert trial.altered_share == pytest.approx(np.mean(broken["p"][30_000:] != healthy[2]["p"][30_000:]))


def test_scenarios_of_different_setups_dont_make_one_study(tmp_path):
    path = tmp_path / "rich.toml"
    path.write_text('excitation = "multisine"\n[[faults]]\nkind = "jam"\nchannels = ["p"]\nonset_s = 300.0\n')
    with pytest.raises(gb.InputError, match=r"'drift' and 'rich' differ in excitation \(dissertation and multisine\)"):
        run_study([load_scenario("drift"), load_scenario(path)])


def test_short_rich_flights_with_several_outputs_run_too(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(
        'excitation = "multisine+turbulence"\nduration_s = 90.0\nnoise = "t2"\nseverity_reference_s = [5.0, 60.0]\n'
        '[operator]\ninputs = ["p", "beta", "ny"]\noutputs = ["r", "q"]\ncausal_order = 20\nnoncausal_order = 0\n'
        "identify_s = [5.0, 40.0]\n[alarm]\nwindow = 200\nthreshold_s = [40.0, 80.0]\nwatch_from_s = 5.0\n"
        '[[faults]]\nkind = "drift"\nchannels = ["r"]\nonset_s = 60.0\nduration_s = 10.0\nslope = 10.0\n'
    )
    (trial,) = gb.run(path)
    assert trial.detected
    assert trial.look_ahead_s == 0.0
    assert 0.0 <= trial.detection_delay_s < 12.0
