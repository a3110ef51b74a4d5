"""Scenarios watched by any detector: what was found is held against the truth, and against the public functions."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import gtmbench as gb
from tests.helpers.night import by_day
from tests.helpers.watching import EXAMPLE, EXCITATION, MIXED, monitor, scenario, study

JAM = MIXED[: MIXED.index("[[faults]]")] + '[[faults]]\nkind = "jam"\nchannels = ["p"]\nonset_s = 60.0\n'


def spikes(record):
    """A detector that is a plain function."""
    return record.time_s[np.abs(record["p"]) > 40.0]


@dataclass(frozen=True)
class Limits(gb.SimpleDetector):
    """An outsider's: it names nobody, and looks at a surface's command."""

    name: str = "limits"
    channels: tuple[str, ...] = ("p", "elevator")
    tied_to_excitation: bool = False

    def learn(self, records):
        return {name: max(np.nanmax(np.abs(record[name])) for record in records) for name in self.channels}

    def scores(self, record, learned):
        return {name: np.abs(record[name]) / learned[name] for name in self.channels}


def short_jam():
    """The jam alone, in half a minute."""
    text = JAM.replace("120.0", "30.0").replace("[25.0, 60.0]", "[5.0, 20.0]").replace("[5.0, 50.0]", "[5.0, 15.0]")
    text = text.replace("[50.0, 100.0]", "[15.0, 25.0]").replace("onset_s = 60.0", "onset_s = 20.0")
    return scenario("jam", text)


def trials():
    names = ("drift", "tiny", "saturation", "jam", "unwatched", "harmless")
    return dict(zip(names, study().trials, strict=True))


def estimates(trial):
    return {estimate.name: estimate for estimate in trial.parameters}


def test_faults_are_found_named_and_told_in_kind():
    for name in ("drift", "saturation", "jam"):
        trial = trials()[name]
        assert trial.detected, name
        assert trial.isolated, name
        assert (trial.sensor, trial.candidates) == (trial.channel, (trial.channel,))
        assert (trial.kind, trial.kind_right, trial.kind_right_20s) == (trial.fault, True, True)
        assert trial.verdict == f"{trial.channel} failed"
        assert trial.detection_delay_s == pytest.approx(trial.alarm_time_s - trial.onset_s, abs=1e-9)
        assert trial.isolation_delay_s == pytest.approx(trial.isolated_s - trial.onset_s, abs=1e-9)
        assert 0.0 < trial.detection_delay_s < trial.isolation_delay_s < 15.0
        assert (trial.reason, trial.false_alarms) == ("", 0)
        assert trial.peak_ratio > 1.0


def test_alarms_before_the_onset_are_false_and_what_they_took_out_of_the_watch_is_said():
    """A jam of p at 40 s that nobody declared, then the fault that counts: a drift of p, or a jam of another sensor."""
    healthy = study().baseline.healthy
    drift, jam = gb.Drift(channel="p", onset_s=80, slope=1.0), gb.Jam(channel="r", onset_s=80)
    broken = gb.inject(healthy, [gb.Jam(channel="p", onset_s=40), drift])
    watch = gb.watch(monitor(), broken)
    verdict = gb.score(watch, fault=drift, healthy=healthy, broken=broken)
    assert (verdict.detected, verdict.false_alarms, list(watch.disarmed)) == (False, 1, ["p"])
    assert watch.alarms[0].time_s <= watch.disarmed["p"] < 80.0
    since = f"no longer watched since {watch.disarmed['p']:.2f} s"
    assert verdict.reason == f"{since}: the fault of an earlier alarm was taken to last"
    both = gb.inject(broken, jam)
    verdict = gb.score(gb.watch(monitor(), both), fault=jam, healthy=healthy, broken=both)
    assert (verdict.false_alarms, verdict.sensor, verdict.isolated) == (1, "r", True)


def test_every_figure_follows_from_the_public_functions():
    flight = gb.fly(excitation=EXCITATION, duration_s=120, seed=1)
    healthy = gb.measure(flight, noise="t2", seed=2001)
    assert (study().baseline.healthy.values == healthy.values).all()
    broken = gb.inject(healthy, gb.Drift(channel="p", onset_s=60, slope=0.3))
    first = gb.watch(monitor(), broken.between(5, 120)).alarms[0]
    trial = trials()["drift"]
    assert (trial.alarm_time_s, trial.isolated_s) == (first.time_s, first.isolated_s)
    assert estimates(trial)["slope"].value == first.last.parameters["slope"]
    for number in (2, 3):
        record = gb.measure(flight, noise="t2", seed=1 + 1000 * number).between(5, 120)
        assert gb.watch(monitor(), record).alarms == ()
    assert study().baseline.false_alarms == 0
    assert 2 * 100 / 3600 < study().baseline.healthy_hours < 2 * 115 / 3600


@pytest.mark.nightly
def test_what_a_monitor_doesnt_use_keeps_no_scenarios_apart_but_flights_do():
    other = scenario("other", JAM.replace("identify_s = [5.0, 50.0]", "identify_s = [9.0, 40.0]"))
    jam = scenario("jam", JAM)
    both = gb.run_study([jam, other], detectors=[monitor()])
    first, two = (trial.row() for trial in both.trials)
    assert {**first, "scenario": ""} == {**two, "scenario": ""}
    again = gb.run_study([jam], detectors=[monitor()], seed=1).trials[0].row()
    assert again == first
    assert gb.run_study([jam], detectors=[monitor()], seed=2).trials[0].row() != first
    calm = scenario("calm", JAM.replace("+turbulence", ""))
    with pytest.raises(gb.InputError, match="'jam' and 'calm' differ in excitation"):
        gb.run_study([jam, calm], detectors=[monitor()])
    with pytest.raises(gb.InputError, match="'jam' and 'other' differ in operator"):
        gb.run_study([jam, other], detectors=[monitor(), "dissertation"])


@pytest.mark.parametrize(
    ("given", "calibration", "each"),
    by_day(
        [
            ((), ["calibrate dissertation"], 1),
            ((monitor,), [], 1),
            ((monitor, lambda: "dissertation", lambda: spikes), ["calibrate dissertation"], 3),
            ((lambda: Limits(),), ["calibration flight 1", "calibration flight 2", "calibrate limits"], 1),
        ],
        2,
    ),
)
def test_progress_is_told_step_by_step(given, calibration, each, monkeypatch):
    monkeypatch.setattr("gtmbench.study.watchers.FLIGHTS", 2)
    told = []
    gb.run_study([short_jam()], detectors=[make() for make in given], progress=lambda *step: told.append(step))
    watched = ["healthy record 1"] * each + ["healthy record 2"] * each + ["jam of p"] * each
    steps = ["trim", "fly", *calibration, *watched]
    assert [step for step, _, _ in told] == [*steps, "done"]
    assert [done for _, done, _ in told] == list(range(len(steps) + 1))
    assert {total for _, _, total in told} == {len(steps)}


def test_a_monitor_of_another_sample_rate_is_refused_in_its_own_words():
    slow = replace(monitor(), sample_period_s=0.02)
    with pytest.raises(gb.InputError, match=r"every 0\.01 s, the monitor was calibrated at 0\.02 s"):
        gb.run_study([scenario()], detectors=[slow])


def test_several_detectors_in_one_study_are_each_as_alone():
    """One row a detector and trial, all on the same records."""
    given = {
        "C": monitor(),
        "dissertation": "dissertation",
        "spikes": spikes,
        "limits": Limits(tied_to_excitation=True),
    }
    together = gb.run_study([short_jam()], detectors=list(given.values()))
    assert [base.detector for base in together.baselines] == list(given)
    assert [trial.detector for trial in together.trials] == list(given)
    for base in together.baselines:
        (trial,) = together.trials_of(base.detector)
        alone = gb.run_study([short_jam()], detectors=[given[base.detector]])
        assert trial.row() == alone.trials[0].row()
        assert (trial.baseline, trial.watch.monitor) == (base, base.monitor)
        assert (base.false_alarms, base.healthy_hours) == (alone.baseline.false_alarms, alone.baseline.healthy_hours)
        assert (base.healthy["p"] == alone.baseline.healthy["p"]).all()
    assert together.baseline is together.baselines[0]


def test_the_example_of_a_detector_of_ones_own_stands_beside_ours(monkeypatch):
    """A file of 25 lines at most: found by its name, calibrated on the study's flights, one row a trial."""
    assert len(EXAMPLE.read_text().splitlines()) <= 25
    monkeypatch.setattr("gtmbench.study.watchers.FLIGHTS", 2)
    watched = gb.run_study([short_jam()], detectors=[f"{EXAMPLE}:LimitCheck", monitor()])
    mine, ours = (trial.row() for trial in watched.trials)
    assert (mine["detector"], ours["detector"]) == ("limit check", "C")
    assert (mine["isolated"], ours["isolated"], ours["sensor"]) == (None, True, "p")
    assert mine.keys() == ours.keys()
    assert watched.baseline.monitor.provenance["flights"] == 2
    assert watched.baseline.healthy_hours == pytest.approx(2 * 25.01 / 3600)
    assert (mine["detected"], mine["reason"][:18]) == (False, "the score reached ")


def test_one_detector_twice_goes_by_two_names():
    watched = gb.run_study([short_jam()], detectors=[monitor(), monitor(), spikes])
    assert [base.detector for base in watched.baselines] == ["C", "C (2)", "spikes"]
    first, two, _ = (trial.row() for trial in watched.trials)
    assert {**first, "detector": ""} == {**two, "detector": ""}


def test_only_who_asks_gets_surface_commands_and_the_sensors_are_the_same():
    with_them = gb.run_study([short_jam()], detectors=[Limits(tied_to_excitation=True)]).baseline
    without = gb.run_study([short_jam()], detectors=[spikes]).baseline
    assert "elevator" in with_them.healthy.channels
    assert "elevator" not in without.healthy.channels
    for channel in without.healthy.channels:
        assert (with_them.healthy[channel] == without.healthy[channel]).all()
    assert set(with_them.watch.scores) == {"p", "elevator"}
    assert with_them.monitor.learned["elevator"] > 0.0


def test_what_learns_nothing_and_what_is_ready_needs_no_flights(monkeypatch):
    monkeypatch.setattr("gtmbench.study.flights.Flown.elsewhere", None)
    ready = gb.FunctionDetector(spikes, name="ready").calibrate()
    for detector in (spikes, ready, monitor(), Limits(tied_to_excitation=True), "dissertation"):
        assert len(gb.run(short_jam(), detectors=[detector])) == 1


@pytest.mark.parametrize("noise", ["t2", "snr 20 of a flight with multisine+turbulence, 30 s"])
def test_a_monitor_of_other_noise_is_refused_before_the_flight(noise, monkeypatch):
    """It would alarm on healthy sensors (for minutes, diagnosing each), or see little."""
    monkeypatch.setattr("gtmbench.study.flights.fly", None)
    learned = replace(gb.FunctionDetector(spikes, name="C").calibrate(), provenance={"noise": noise})
    setup = replace(short_jam().setup, noise=None, snr=50.0)
    with pytest.raises(gb.InputError, match=f"'C' was calibrated .* noise '{noise[:6]}.* the scenario's have 'snr 50 "):
        gb.run_study([replace(short_jam(), setup=setup)], detectors=[spikes, learned])
    monkeypatch.undo()
    same = short_jam() if noise == "t2" else replace(short_jam(), setup=replace(setup, snr=20.0))
    assert len(gb.run(same, detectors=[learned])) == 1


@pytest.mark.parametrize("given", ["C", gb.DissertationOperator(), spikes])
def test_one_detector_alone_is_no_list_of_them(given):
    with pytest.raises(gb.InputError, match=r"^detectors is .*; give a list of them, detectors=\[\.\.\.\]$"):
        gb.run("jam", detectors=given)


@pytest.mark.parametrize(
    ("detector", "words"),
    [
        ("jim", "no detector is called 'jim'; there are dissertation, auto, B,"),
        (3, "3 is a int, no detector"),
        (
            gb.FunctionDetector(spikes, channels=("p", "strain")),
            "'spikes' needs strain, which no flight has; there are",
        ),
    ],
)
def test_what_cant_watch_a_study_is_refused_before_the_flight(detector, words, monkeypatch):
    monkeypatch.setattr("gtmbench.study.flights.fly", None)
    with pytest.raises(gb.InputError, match=words):
        gb.run_study([short_jam()], detectors=[detector])


@pytest.mark.parametrize(("snr", "noise"), by_day([(50.0, None), (None, "t2")]))
def test_a_detector_is_calibrated_with_the_noise_that_the_studys_sensors_have(snr, noise, monkeypatch):
    given = []

    class Keeping(Limits):
        def learn(self, records):
            given.extend(records)
            return super().learn(records)

    monkeypatch.setattr("gtmbench.study.watchers.FLIGHTS", 2)
    setup = replace(short_jam().setup, excitation="dissertation", duration_s=20.0, snr=snr, noise=noise)
    base = gb.run_study(
        [replace(short_jam(), setup=setup)], detectors=[Keeping(channels=("p", "beta", "phi"))]
    ).baseline
    assert base.monitor.provenance["flights"] == 2
    assert base.monitor.provenance["noise"] == noise or base.monitor.provenance["noise"].startswith(
        "snr 50 of a flight"
    )
    for number, record in enumerate(given):
        truth = gb.fly(excitation=EXCITATION, duration_s=20.0, seed=1_000_000_001 + number)
        for channel in ("p", "beta", "phi"):
            own = np.std(base.healthy[channel] - base.flight[channel])
            assert np.std(record[channel] - truth[channel]) == pytest.approx(own, rel=0.1)
    assert not (given[0]["p"] == given[1]["p"]).any()


def test_scenarios_that_state_no_noise_have_the_t2s_where_anything_but_their_own_operator_watches():
    unstated = replace(scenario("unstated", JAM.replace('noise = "t2"\n', "")), faults=())
    assert gb.run_study([unstated]).baseline.setup.snr == 50.0
    for detectors in ([spikes], ["dissertation", spikes]):
        setup = gb.run_study([unstated], detectors=detectors).baseline.setup
        assert (setup.snr, setup.noise) == (None, "t2")


def test_faults_may_be_given_instead_of_the_scenarios():
    given = [gb.Jam(channel="q", onset_s=21.0), gb.Drift(channel="r", onset_s=22.0, slope=0.5)]
    trials = gb.run(short_jam(), detectors=[spikes], faults=given)
    assert [trial.injected for trial in trials] == given
    assert [(trial.fault, trial.channel, trial.severity) for trial in trials] == [
        ("jam", "q", {}),
        ("drift", "r", {"slope": 0.5}),
    ]
