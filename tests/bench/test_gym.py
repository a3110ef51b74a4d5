"""The Gymnasium environment: its own checker, what is observed, rewarded and ended, seeds, options, vectors."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import gtmbench as gb
from gtmbench.gym import ID, GtmEnv
from tests.helpers.night import by_day

REST = np.zeros(4, dtype=np.float32)


def flown(env, actions=None, **reset):
    """Fly an episode; return observations, rewards and the last answer."""
    seen, _ = env.reset(**reset)
    observations, rewards = [seen], []
    while True:
        action = REST if actions is None else actions(seen)
        seen, reward, terminated, truncated, info = env.step(action)
        observations.append(seen)
        rewards.append(reward)
        if terminated or truncated:
            return np.array(observations), np.array(rewards), (terminated, truncated, info)


@pytest.mark.parametrize(
    "how", by_day([{}, {"aircraft": "c172p"}, {"sensors": "chain", "attitude": "filter 1 s"}]), ids=str
)
def test_gymnasiums_own_checker_finds_nothing(how):
    """Warnings are errors here."""
    check_env(gymnasium.make(ID, duration_s=2.0, **how).unwrapped)


def test_the_same_seed_is_the_same_episode_and_the_generator_goes_on():
    def air(random):
        return gb.Bias(channel="q", onset_s=float(random.uniform(0.2, 0.5)), size=2.0)

    one, other = (gymnasium.make(ID, duration_s=1.0, faults=air, targets={"psi_deg": [-20.0, 20.0]}) for _ in range(2))
    first = flown(one, seed=7)
    np.testing.assert_array_equal(first[0], flown(other, seed=7)[0])
    second = flown(one)
    np.testing.assert_array_equal(second[0], flown(other)[0])
    assert not np.array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[0], flown(one, seed=7)[0])


def test_no_action_flies_the_trim_as_a_simulation_does():
    env = GtmEnv(duration_s=2.0)
    flown(env, seed=1)
    flight = env.simulation.flight()
    alone = gb.Simulation(duration_s=2.0)
    alone.reset(env.simulation._seed)
    while not alone.is_over:
        alone.step(list(alone.trim.commands.values()))
    assert flight.sensed.values.tobytes() == alone.flight().sensed.values.tobytes()


def test_the_reward_is_of_the_truth_and_the_observation_of_the_sensors():
    env = GtmEnv(duration_s=2.0)
    healthy = flown(env, seed=1)
    broken = flown(env, seed=1, options={"faults": gb.Bias(channel="altitude", onset_s=1.0, size=500.0)})
    np.testing.assert_array_equal(healthy[1], broken[1])
    altitude = gb.Readings._fields.index("altitude")
    assert (broken[0] - healthy[0])[:, altitude].round(3).tolist() == [0.0] * 50 + [5.0] * 51
    truth = env.simulation.flight().truth
    errors = (truth["altitude"][-1] - 8000.0) / 50, (truth["psi"][-1] - 45.0) / 10, (truth["tas"][-1] - 100.58) / 10
    assert broken[1][-1] == pytest.approx(np.exp(-0.5 * np.sum(np.square(errors))), abs=1e-9)


def test_a_missing_reading_is_the_last_one():
    env = GtmEnv(duration_s=2.0, noise=None)
    seen, _, _ = flown(env, seed=1, options={"faults": gb.Dropout(channel="p", onset_s=1.0)})
    assert np.isfinite(seen).all()
    assert len(set(seen[50:, 0].tolist())) == 1


@pytest.mark.nightly
def test_an_autopilot_flies_in_it_by_its_commands():
    env = GtmEnv(duration_s=60.0, samples_a_step=1)
    craft = env.simulation.aircraft
    env.reset(seed=3)
    command = craft.autopilot.engage(env.simulation.trim, craft.limits, 0.01)
    _, rewards, (terminated, _, _) = flown(env, lambda _: env.action_of(command(env.simulation.readings)), seed=3)
    assert rewards.mean() > 0.8
    assert flown(env, seed=3)[1].mean() < 0.5 * rewards.mean()
    assert not terminated


def test_a_target_is_away_from_trim():
    env = GtmEnv(duration_s=1.0, noise=None, excitation=gb.Excitation(), targets={"altitude_ft": 100.0})
    seen, info = env.reset(seed=1)
    assert seen[gb.Readings._fields.index("altitude")] == pytest.approx(-1.0)
    assert info["targets"] == {"altitude_ft": 100.0, "psi_deg": 0.0, "tas_kt": 0.0}
    seen, info = env.reset(seed=1, options={"targets": {"psi_deg": [30.0, 30.0]}})
    assert info["targets"] == {"altitude_ft": 100.0, "psi_deg": 30.0, "tas_kt": 0.0}
    assert seen[gb.Readings._fields.index("psi")] == pytest.approx(-1.0)


def test_it_ends_by_time_by_departure_and_by_the_envelope():
    assert flown(GtmEnv(duration_s=1.0), seed=1)[2] == (False, True, {"end": "duration"})
    rolling = flown(GtmEnv(), lambda _: np.array([0, 1, 0, 0], dtype=np.float32), seed=1)
    assert rolling[2] == (True, False, {"end": "departure"})
    narrow = replace(gb.load_aircraft("gtm"), envelope={"alpha": (-5.0, 85.0), "altitude": (7990.0, 8010.0)})
    assert flown(GtmEnv(narrow, duration_s=200.0), seed=1)[2] == (False, True, {"end": "envelope"})


@pytest.mark.parametrize("mode", by_day(["sync", "async"]))
def test_vectors_fly_what_single_ones_fly(mode):
    many = gymnasium.make_vec(ID, num_envs=2, vectorization_mode=mode, duration_s=1.0)
    try:
        seen, _ = many.reset(seed=[5, 6])
        for _ in range(10):
            seen, rewards, *_ = many.step(np.zeros((2, 4), dtype=np.float32))
    finally:
        many.close()
    for row, seed in enumerate((5, 6)):
        observations, alone, _ = flown(gymnasium.make(ID, duration_s=1.0), seed=seed)
        np.testing.assert_array_equal(seen[row], observations[10])
        assert rewards[row] == pytest.approx(alone[9])


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: GtmEnv(render_mode="human"), "render_mode is 'human'"),
        (lambda: GtmEnv(samples_a_step=0), "samples_a_step"),
        (lambda: GtmEnv(targets={"altitude": 3.0}), "altitude"),
        (lambda: GtmEnv(targets={"psi_deg": [3.0, 1.0]}), "the first must not be more"),
        (lambda: GtmEnv().reset(options={"fault": 3}), "fault"),
        (lambda: GtmEnv().reset(options={"faults": ["jam"]}), "is no fault"),
        (lambda: flown(GtmEnv(), lambda _: np.zeros(3)), "give 4 numbers"),
        (lambda: flown(GtmEnv(), lambda _: np.full(4, np.nan)), "finite numbers"),
    ],
)
def test_bad_input_is_one_line(wrong, said):
    with pytest.raises(gb.InputError, match=said):
        wrong()
