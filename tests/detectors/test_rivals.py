"""Rivals: every one keeps the contract, is what its source says, and is judged by the banks' rule."""

import inspect
import json
import re
import sys
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are
from scipy.signal import lfilter

import gtmbench as gb
from gtmbench.detectors.rivals.autoencoder import Autoencoder, _repeated
from gtmbench.detectors.rivals.catalogue import RIVALS
from gtmbench.detectors.rivals.isolation_forest import IsolationForest
from gtmbench.detectors.rivals.judging import Level
from gtmbench.detectors.rivals.kalman import STATES, LinearKalmanFilter, _erring, _identified
from gtmbench.detectors.rivals.kinematic_kalman import KinematicKalmanFilter, _gain
from gtmbench.detectors.rivals.ksfd import KinematicConsistency
from gtmbench.detectors.rivals.limit_checks import LimitChecks
from gtmbench.detectors.rivals.one_step import OneStepPrediction
from gtmbench.detectors.rivals.pca import PrincipalComponents
from gtmbench.detectors.rivals.recursive import RecursiveLeastSquares
from gtmbench.detectors.rivals.rival import JUDGES
from gtmbench.detectors.rivals.rival_stream import named
from gtmbench.detectors.rivals.signals import CHANNELS, FEATURES, Scale, body_increments, features_of, with_turns
from gtmbench.detectors.statistics.statistic import Allowance
from gtmbench.detectors.statistics.whitening import White
from gtmbench.testing.contract.subject import contract_case, standard_records
from gtmbench.testing.contract.suite import CONTRACT, check_property
from gtmbench.testing.shared_flights import fly_once
from tests.helpers.monitors import record, truth
from tests.helpers.night import by_day
from tests.helpers.sealed import resealed

PERIOD_S = 0.02


@dataclass(frozen=True, kw_only=True)
class Lax(IsolationForest):
    """Wanted to alarm falsely: of four minutes no rare score can be told, and its own can't pass 1."""

    def calibrate(self, records, false_alarms_per_hour=None, **more):
        return super().calibrate(records, 100.0 if false_alarms_per_hour is None else false_alarms_per_hour, **more)


LOUD = [
    gb.Noise(channel=gyro, onset_s=at, deviation=300.0, seed=1, duration_s=12.0) for gyro in "pqr" for at in (48, 84)
]


@cache
def case_of(name):
    return contract_case(Lax(), fault=LOUD) if name == "isolation-forest" else contract_case(name)


@pytest.mark.parametrize(("name", "prop"), by_day(product(RIVALS, CONTRACT), 3, seed=78))
def test_every_rival_keeps_the_contract(name, prop):
    check_property(case_of(name), prop)


@pytest.mark.parametrize("rival", RIVALS.values(), ids=list(RIVALS))
def test_every_rival_names_its_source_and_stands_in_the_page(rival):
    source = sys.modules[type(rival).__module__].__doc__
    assert re.search(r"doi:10\.\d{4}|arXiv:\d{4}\.\d{5}", " ".join(source.split()))
    page = (Path(__file__).parents[2] / "docs/explanation/rivals.md").read_text()
    assert f"`{rival.name}`" in page
    assert Path(inspect.getfile(type(rival))).name in page


# --- judged alike


def test_an_alarm_tells_how_far_back_the_test_looks_that_raised_it():
    rival = KinematicKalmanFilter()
    monitor = rival.calibrate([record(3000, seed=seed) for seed in (1, 2, 3)])
    broken = gb.inject(record(3000, seed=4), gb.Bias(channel="p", onset_s=20.0, size=50.0))
    alarm = next(alarm for alarm in monitor.watch(broken).faults if alarm.time_s >= 20.0)
    looked_back = round((alarm.time_s - alarm.onset_s) / broken.sample_period_s)
    assert looked_back in JUDGES[rival.judge].rows(broken.sample_period_s)


def test_a_lower_rate_never_lowers_a_threshold():
    healthy = [record(3000, seed=seed) for seed in (1, 2, 3)]
    often, seldom = (LimitChecks().calibrate(healthy, rate) for rate in (1.0, 0.01))
    for name, judging in often.judgings.items():
        assert all(seldom.judgings[name].thresholds[label] >= value for label, value in judging.thresholds.items())


def test_the_model_stands_on_every_third_record_and_thresholds_on_the_others():
    healthy = [record(3000, seed=seed) for seed in range(1, 7)]
    rival = KinematicKalmanFilter()
    monitor, other = (rival.calibrate(part) for part in (healthy, [healthy[0], *healthy[4:3:-1], *healthy[2:]]))
    assert monitor.model["taps"].tolist() == other.model["taps"].tolist()  # records 0 and 3
    assert monitor.judgings["p"].thresholds != other.judgings["p"].thresholds


@given(st.lists(st.none() | st.floats(0.0, 1e6), min_size=1, max_size=40), st.integers(1, 10))
def test_a_level_is_the_mean_of_the_last_values_that_exist(values, rows):
    raw = np.array([np.nan if value is None else value for value in values])
    (score,) = Level(windows_s=(rows * 0.1,)).scores(raw, White.steady(np.zeros(len(raw))), 0.1, Allowance())
    for k, value in enumerate(score.values):
        last = raw[: k + 1][~np.isnan(raw[: k + 1])][-rows:]
        if np.isnan(raw[k]) or len(last) < rows:
            assert np.isnan(value)
        else:
            np.testing.assert_allclose(value, last.mean(), rtol=1e-12, atol=1e-9)


# --- which gyro


@given(st.lists(st.floats(0.0, 100.0), min_size=3, max_size=3), st.permutations("pqr"))
def test_whoever_is_named_stands_out_whatever_its_name(peaks, names):
    said, other = (named(dict(zip(order, peaks, strict=True)), 1.0) for order in ("pqr", names))
    assert (said.sensor is None) == (other.sensor is None)
    ranked = sorted(peaks)
    assert (said.sensor is not None) == (ranked[-1] > 1.0 and 2.0 * ranked[-2] < ranked[-1])
    if said.sensor is not None:
        assert peaks["pqr".index(said.sensor)] == ranked[-1]
        assert names["pqr".index(said.sensor)] == other.sensor


@pytest.mark.nightly
def test_whose_residuals_are_of_no_gyro_names_none():
    assert {name for name in RIVALS if not case_of(name).monitor.suspects} == {"pca", "dynamic-pca", "isolation-forest"}


def test_an_alarm_within_the_longest_window_counts_to_the_same_fault():
    monitor = LimitChecks().calibrate([record(3000, seed=seed) for seed in (1, 2, 3)])
    spikes = np.array(record(6000, seed=4).values)
    for at_s in (20.0, 30.0, 70.0):
        spikes[round(at_s / PERIOD_S), 0] = 500.0
    watch = monitor.watch(gb.Record(spikes, channels=record(1).channels, sample_period_s=PERIOD_S))
    assert sorted({round(alarm.time_s) for alarm in watch.alarms}) == [20, 30, 70]
    assert [round(alarm.time_s) for alarm in watch.faults] == [20, 70]
    assert [alarm.sensor for alarm in watch.faults] == ["p", "p"]


# --- each is what its source says


def test_increments_are_the_rates_of_the_attitude():
    smooth = truth(2000)
    rates = body_increments(smooth.matrix(["phi", "theta", "psi"])) / PERIOD_S
    halfway = (smooth.matrix(["p", "q", "r"])[1:] + smooth.matrix(["p", "q", "r"])[:-1]) / 2.0
    np.testing.assert_allclose(rates[1:], halfway, atol=2e-3 * np.abs(halfway).max())


def test_limits_are_those_of_the_samples():
    values = np.array([[1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 1.0, 0.0]])
    made = LimitChecks(flat_s=2 * PERIOD_S).generator({}, PERIOD_S).push(values)
    assert made[1:, 0].tolist() == [3.0, 3.0]
    assert made[1:, 3].tolist() == [2.0 / PERIOD_S, 0.0]
    np.testing.assert_allclose(1.0 / made[1:, 6], [2.0, 0.0], atol=1e-5)


def test_t2_and_q_of_all_components_are_mahalanobis_and_nothing():
    random = np.random.default_rng(1)
    values = random.standard_normal((4000, 12)) @ random.standard_normal((12, 12))
    rival = PrincipalComponents(explained=1.0 - 1e-12)
    made = rival.generator(rival.fit([values], PERIOD_S), PERIOD_S).push(values)
    x = with_turns(values, rival.channels)[5::5]
    wanted = np.einsum("ij,jk,ik->i", x - x.mean(axis=0), np.linalg.inv(np.cov(x.T)), x - x.mean(axis=0))
    np.testing.assert_allclose(made[5::5, 0], wanted, rtol=1e-6)
    assert np.nanmax(made[:, 1]) < 1e-9


def test_one_step_prediction_finds_the_noise_that_drives_its_own_model():
    random, rival = np.random.default_rng(1), OneStepPrediction(past_s=3 * PERIOD_S, commands=False)
    values = random.standard_normal((20_000, len(rival.channels)))
    noise = values[:, 0].copy()
    driven = noise + 0.5 * np.roll(values[:, 6], 1) - 0.3 * np.roll(values[:, 7], 3)
    values[:, 0] = lfilter([1.0], [1.0, -0.6], driven)
    model = rival.fit([values], PERIOD_S)
    errors = rival.generator(model, PERIOD_S).push(values)
    assert model["markov"][0, 0, 0] == pytest.approx(0.6, abs=0.02)
    assert model["markov"][0, 0, 6] == pytest.approx(0.5, abs=0.02)
    assert model["markov"][2, 0, 7] == pytest.approx(-0.3, abs=0.02)
    np.testing.assert_allclose(errors[100:, 0], noise[100:], atol=0.2)


def test_without_its_own_past_a_gyro_isnt_predicted_from_itself():
    rival = OneStepPrediction(past_s=0.1, commands=False, own_past=False)
    markov = rival.fit([np.random.default_rng(1).standard_normal((3000, 12))], PERIOD_S)["markov"]
    assert all(not markov[:, i, i].any() and markov[:, i, 3].all() for i in range(3))


def test_the_kalman_filters_model_is_that_of_the_flight():
    """Of linear motion the matrices come out, within what smoothing leaves; the erring one keeps its kinematics."""
    random, states = np.random.default_rng(1), len(STATES)
    a = -1.0 * np.eye(states) + 0.3 * random.standard_normal((states, states))
    b = random.standard_normal((states, 4))
    commands = lfilter([0.02], [1.0, -0.98], random.standard_normal((40_000, 4)), axis=0) * 20.0
    x, servo, rows = np.zeros(states), np.zeros(4), []
    for u in commands:
        rows.append(np.concatenate([x, x[:3], u]))
        x, servo = x + 0.01 * (a @ x + b @ servo), servo + 0.01 * 31.4 * (u - servo)
    found = _identified([np.array(rows)], 0.01, 31.4)
    np.testing.assert_allclose(found.a, a, atol=0.2)
    np.testing.assert_allclose(found.b, b, atol=0.2)
    off = _erring(found, 0.2)
    assert set(np.round(off.b / found.b, 6).ravel()) == {0.8, 1.2}
    assert off.a[3, 1] == found.a[3, 1]
    assert (off.a[6:] == found.a[6:]).all()


def test_a_filter_without_readings_only_predicts():
    case = case_of("kalman")
    values = np.array(case.record.select(case.monitor.channels).values)[:500]
    generator = case.monitor.generator()
    generator.push(values)
    state = generator._state.copy()
    values[:1, 0] = np.nan
    made = generator.push(values[:1])
    system = generator._system
    commands = (values[0] - generator._mean)[len(system.output) :]
    np.testing.assert_allclose(generator._state, system.transition @ state + system.command @ commands)
    assert np.isnan(made[0, 0])


def test_the_kinematic_gain_is_that_of_the_riccati_equation():
    random = np.random.default_rng(1)
    q, r = 0.3, 1.0
    noise = np.sqrt(r) * random.standard_normal(200_001)
    increments = np.sqrt(q) * random.standard_normal(200_000) + np.diff(noise)
    p = solve_discrete_are(np.eye(1), np.eye(1), np.array([[q]]), np.array([[r]]))[0, 0]
    assert _gain([increments]) == pytest.approx(p / (p + r), rel=0.03)


@pytest.mark.parametrize("late", [0, 3])
def test_the_fir_takes_up_how_late_the_attitude_is(late):
    smooth = truth(8000)
    angles = np.roll(smooth.matrix(["phi", "theta", "psi"]), late, axis=0)[10:]
    values = np.hstack([smooth.matrix(["p", "q", "r"])[10:], angles])
    values += np.array([0.5, 0.5, 0.3, 0.02, 0.02, 0.02]) * np.random.default_rng(1).standard_normal(values.shape)
    model = KinematicKalmanFilter(past_s=0.14).fit([values], PERIOD_S)
    lags = np.arange(model["taps"].shape[1])
    np.testing.assert_allclose(model["taps"].sum(axis=1), 1.0, atol=0.03)
    np.testing.assert_allclose(model["taps"] @ lags, late + 0.5, atol=0.3)


@pytest.mark.parametrize("bias", [np.zeros(3), np.array([5.0, 0.0, 0.0])])
def test_kinematics_agrees_on_a_flight_without_noise_but_for_a_bias(bias):
    rival = KinematicConsistency(judge="glr")
    values = np.array(fly_once(duration_s=120.0).select(rival.channels).values)[2000:]
    values[:, :3] += bias
    errors = rival.generator({}, 0.01).push(values)[100:]
    np.testing.assert_allclose(errors[:, :3].mean(axis=0), bias, atol=0.1)
    # m/s2; of p, V times the mean angle of attack in the lateral equation
    level = np.abs(errors[:, 3:].mean(axis=0))
    assert (level < 0.1).all() if not bias.any() else 0.1 < level[1] < 1.0


def test_recursive_least_squares_are_least_squares_that_forget():
    rival = RecursiveLeastSquares(remembered_s=5.0, smoothed_s=1e-6)
    values = np.array(standard_records()[0].select(rival.channels).values)[:600]
    scale = Scale.of(with_turns(values, rival.channels)[1:])
    generator = rival.generator({"mean": scale.mean, "deviation": scale.deviation}, PERIOD_S)
    errors = generator.push(values)
    x = scale.standard(with_turns(values, rival.channels))[1:]
    past = np.column_stack([np.vstack([np.zeros(x.shape[1]), x[:-1]]), np.ones(len(x))])[:, 1:]  # p from the others
    forgetting = np.exp(-PERIOD_S / 5.0)
    weights = forgetting ** np.arange(len(x) - 1)[::-1]
    gram = (past[:-1].T * weights) @ past[:-1] + forgetting ** len(weights) / 10.0 * np.eye(past.shape[1])
    theta = np.linalg.solve(gram, (past[:-1].T * weights) @ x[:-1, 0])
    assert errors[-1, 0] == pytest.approx(x[-1, 0] - theta @ past[-1], abs=1e-6)


@cache
def windows():
    values = standard_records()[0].select(CHANNELS).values
    return [values], features_of(values, 25, PERIOD_S)


def test_features_are_those_of_the_window():
    (values,), features = windows()
    window = values[476:501, 0]
    wanted = [window.mean(), window.std(), window[-1] - window[0], np.abs(np.diff(window)).mean()]
    np.testing.assert_allclose(features[500, :4], wanted)
    assert features.shape == (len(values), FEATURES)


def test_the_forests_tables_score_as_its_library_does():
    ensemble = pytest.importorskip("sklearn.ensemble")
    records, features = windows()
    rival = IsolationForest(trees=20)
    model = rival.fit(records, PERIOD_S)
    scale = Scale(mean=model["mean"], deviation=model["deviation"])
    there = np.isfinite(features).all(axis=1)
    learnt = features[::5][there[::5]]
    forest = ensemble.IsolationForest(n_estimators=20, random_state=0).fit(scale.standard(learnt))
    made = rival.generator(model, PERIOD_S).push(records[0])
    np.testing.assert_allclose(made[there, 0], -forest.score_samples(scale.standard(features[there])), rtol=1e-6)


def test_the_networks_tables_repeat_as_its_library_does():
    networks = pytest.importorskip("sklearn.neural_network")
    records, features = windows()
    rival = Autoencoder(epochs=20)
    model = rival.fit(records, PERIOD_S)
    x = Scale(mean=model["mean"], deviation=model["deviation"]).standard(features[np.isfinite(features).all(axis=1)])
    network = networks.MLPRegressor(hidden_layer_sizes=(64, 16, 64))
    network.n_layers_, network.out_activation_ = 5, "identity"
    network.coefs_ = [model[f"weights {i}"] for i in range(4)]
    network.intercepts_ = [model[f"biases {i}"] for i in range(4)]
    np.testing.assert_allclose(_repeated(model, x), network.predict(x), rtol=1e-9, atol=1e-9)
    assert np.square(_repeated(model, x) - x).mean() < 1.0  # it has learnt something


# --- bad input


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("rival") / "kinematic.json"
    gb.save_monitor(KinematicKalmanFilter().calibrate([record(3000, seed=seed) for seed in (1, 2, 3)]), path)
    return path


def _changed(key, value):
    return lambda figures: figures | {key: value}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_changed("name", "nobody"), "figures.name is 'nobody'; there are limits, cusum"),
        (_changed("model", {}), "the model of 'kinematic-kalman' doesn't fit its parameters; calibrate anew"),
        (lambda f: f | {"model": f["model"] | {"gain": [0.1]}}, "doesn't fit its parameters; calibrate anew"),
        (lambda f: f | {"model": f["model"] | {"gain": [[0.1], 2]}}, r"model.gain is .* must be lists of numbers"),
        (lambda f: f | {"recipe": f["recipe"] | {"past_s": "long"}}, "recipe.past_s is 'long'; .* has 0.15 there"),
        (lambda f: f | {"recipe": f["recipe"] | {"judge": "jury"}}, "recipe.judge is 'jury'"),
        (lambda f: f | {"recipe": {}}, "recipe: key .* is missing"),
        (lambda f: f | {"judgings": {"p": f["judgings"]["p"]}}, "judgings: key 'q' is missing"),
    ],
)
def test_a_file_that_was_changed_is_refused_in_one_line(saved, tmp_path, change, said):
    document = json.loads(saved.read_text())
    path = tmp_path / "changed.json"
    path.write_text(json.dumps(resealed(document | {"figures": change(document["figures"])})))
    with pytest.raises(gb.InputError, match=said) as refused:
        gb.load_monitor(path)
    assert "\n" not in str(refused.value)


def test_without_its_library_a_rival_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.decomposition", None)
    with pytest.raises(gb.InputError, match=r"'pca' needs the package sklearn; pip install 'gtmbench\[rivals\]'"):
        PrincipalComponents().calibrate(standard_records())


def test_records_that_are_too_short_are_refused():
    with pytest.raises(gb.InputError, match="of 'kalman' is missing; give longer records"):
        LinearKalmanFilter().calibrate([each.between(1.0, 15.0) for each in standard_records()])


def test_parameters_are_kept_with_a_file(tmp_path):
    rival = replace(LimitChecks(), flat_s=0.5)
    gb.save_monitor(rival.calibrate([record(3000, seed=seed) for seed in (1, 2, 3)]), tmp_path / "limits.json")
    assert gb.load_monitor(tmp_path / "limits.json").rival == rival
