"""Calibration: healthy records in, a monitor out that stays quiet as often as asked, whatever plant, units and rate."""

import numpy as np
import pytest
from scipy import stats

import gtmbench as gb
from gtmbench.detectors.bank.bank import bank_of
from gtmbench.detectors.bank.calibrated import bank_residuals
from gtmbench.detectors.bank_detector import calibrate
from gtmbench.detectors.monitor.scores import bank_alarms, crossings, residual_scores
from gtmbench.detectors.protocol import watch
from gtmbench.detectors.statistics.statistic import STATISTICS
from gtmbench.errors import InputError
from gtmbench.values.record import Record
from tests.helpers.monitors import record as made_up
from tests.helpers.night import by_day

SENSORS = ("inlet", "outlet", "wall")


def bank(period_s=0.1, **alarm):
    """Return a bank for a process of three sensors: two residuals, orders of 3 and 2 samples at any rate."""
    look = {"look_back_s": 3 * period_s, "look_ahead_s": 2 * period_s}
    return bank_of(
        "toy",
        {
            "whitening_s": 5 * period_s,
            "residuals": [
                {"output": "outlet", "inputs": ["inlet"], **look},
                {"output": "wall", "inputs": ["inlet", "outlet"], **look},
            ],
            "alarm": {"windows_s": [w * period_s for w in (8, 32, 128)], "baseline_s": 600 * period_s, **alarm},
        },
    )


def plant(samples, seed, period_s=0.1, noise=1.0):
    """Return a record of an exact noncausal FIR plant with white sensor noise on the outputs."""
    rng = np.random.default_rng(seed)
    inlet = np.cumsum(rng.standard_normal(samples + 10)) * 0.1 + 5.0 * rng.standard_normal(samples + 10)
    outlet = np.convolve(inlet, [0.5, 1.0, -0.7, 0.2, 0.1, 0.05], mode="same") + 40.0
    wall = np.convolve(inlet, [0.1, 0.3, 0.3, 0.1], mode="same") - 0.5 * outlet
    values = np.column_stack([inlet, outlet, wall])[5:-5]
    values[:, 1:] += noise * rng.standard_normal((samples, 2))
    return Record(values, channels=SENSORS, sample_period_s=period_s, start_s=100.0)


def false_alarms(monitor, records):
    return sum(len(bank_alarms(monitor, record)) for record in records)


@pytest.mark.parametrize("period_s", by_day([0.1, 0.04, 0.01]))
def test_healthy_records_that_it_never_saw_are_quiet_and_a_broken_one_isnt(period_s):
    records = [plant(6000, seed, period_s) for seed in range(6)]
    monitor = calibrate(records, bank=bank(period_s))
    assert monitor.sample_period_s == period_s
    for seed in range(10, 16):
        assert watch(monitor, plant(6000, seed, period_s)).alarms == ()
    healthy = plant(6000, 20, period_s)
    broken = healthy.replace("wall", healthy["wall"] + np.where(np.arange(6000) >= 4000, 3.0, 0.0))
    first = watch(monitor, broken).faults[0]
    assert first.source == "wall"
    # 3 deviations: 9/2 nats a sample are beyond any threshold after 10, of a window of 8 or 32
    assert healthy.time_s[4000] <= first.time_s <= healthy.time_s[4000] + 32 * period_s


@pytest.mark.nightly
@pytest.mark.parametrize("name", by_day(STATISTICS))
def test_false_alarms_come_no_more_often_than_asked(name):
    # 240 blocks of a minute for the tails, then 15 h that calibration never saw. The series of a residual overlap and
    # rise together, so there are fewer alarms than asked
    monitor = calibrate(
        [plant(36_000, seed) for seed in range(6)], bank=bank(statistic=name, two_sided=True), false_alarms_per_hour=1.0
    )
    count = false_alarms(monitor, [plant(36_000, 100 + seed) for seed in range(15)])
    assert 0 < count <= stats.poisson.isf(1e-4, 15.0)


def test_a_higher_rate_gives_lower_thresholds():
    records = [plant(6000, seed) for seed in range(3)]
    rare, often = (calibrate(records, bank=bank(), false_alarms_per_hour=rate) for rate in (1e-3, 10.0))
    for output, thresholds in rare.thresholds.items():
        assert all(value > often.thresholds[output][label] for label, value in thresholds.items())


@pytest.mark.parametrize("name", by_day(STATISTICS))
def test_units_dont_matter(name):
    units = {"inlet": 1e-3, "outlet": 1e3, "wall": 25.4}

    def converted(record):
        return Record(
            record.values * list(units.values()) + [273.0, 0.0, -5.0],
            channels=SENSORS,
            sample_period_s=0.1,
            start_s=100.0,
        )

    records, used = [plant(6000, seed) for seed in range(4)], bank(statistic=name, two_sided=True)
    here, there = calibrate(records, bank=used), calibrate([converted(healthy) for healthy in records], bank=used)
    fresh = plant(6000, 11)
    broken = fresh.replace("outlet", fresh["outlet"] + np.where(np.arange(6000) > 3000, 2.0, 0.0))
    for record in (fresh, broken):
        residuals = (bank_residuals(here, record), bank_residuals(there, converted(record)))
        these, those = (
            residual_scores(here, record, residuals[0]),
            residual_scores(there, converted(record), residuals[1]),
        )
        for output in these:
            np.testing.assert_allclose(those[output].values, these[output].values, rtol=1e-6, atol=1e-6)
        rises = [[(each.output, each.row, each.test) for each in crossings(tracks, 0.0)] for tracks in (these, those)]
        assert rises[0] == rises[1]
        assert bool(rises[0]) == (record is broken)


def test_the_seen_records_themselves_are_quiet():
    # what stands at a record's end, in a block that isn't complete, was seen as well
    jolted = plant(6250, 1)
    wall = np.array(jolted["wall"])
    wall[6200] += 40.0
    records = [plant(6000, 0), jolted.replace("wall", wall), plant(6000, 2)]
    for name in STATISTICS:
        used = bank(statistic=name)
        # one sample that is far off is clipped where the noise is learnt
        assert (false_alarms(calibrate(records[::2], bank=used), records[1:2]) > 0) == (name == "energy")
        assert false_alarms(calibrate(records, bank=used), records[1:]) == 0


def test_one_record_is_cut_and_several_are_dealt_out():
    records = [plant(6000, seed) for seed in range(3)]
    joined = plant(20_000, 4)
    several, single = calibrate(records, bank=bank()), calibrate(joined, bank=bank())
    assert several.provenance["records"] == 3
    assert several.provenance["identification_hours"] == pytest.approx(600.0 / 3600.0)
    assert several.provenance["threshold_hours"] == pytest.approx(1200.0 / 3600.0)
    assert single.provenance["identification_hours"] == pytest.approx(0.4 * 2000.0 / 3600.0, abs=1e-3)
    assert single.provenance["threshold_hours"] == pytest.approx(0.6 * 2000.0 / 3600.0, abs=1e-3)
    # thresholds are set on records that didn't identify: 0.33 h without an alarm bound the rate at 3.0 / 0.33
    assert several.provenance["false_alarms_per_hour_at_most"] == pytest.approx(8.987, abs=1e-3)
    identified = gb.identify(records[0], inputs=["inlet"], outputs=["outlet"], causal_order=3, noncausal_order=2)
    np.testing.assert_array_equal(several.operators["outlet"].markov, identified.markov)
    for monitor in (several, single):
        assert watch(monitor, plant(6000, 10)).alarms == ()


def test_steps_are_told_as_they_are_done():
    told = []
    calibrate([plant(2000, seed) for seed in range(4)], bank=bank(), progress=lambda *step: told.append(step))
    assert [done for _, done, _ in told] == sorted(done for _, done, _ in told)
    assert len({of for _, _, of in told}) == 1
    assert told[-1][1] == told[-1][2]


# healthy but imperfect sensors


IMPERFECT = [gb.Imperfections(lag_s=0.2), gb.Imperfections(quantum=8.0), gb.Imperfections(wander=0.3)]


@pytest.mark.parametrize("imperfections", by_day(IMPERFECT, 0), ids=str)
def test_a_monitor_lives_with_the_imperfections_it_was_calibrated_with(imperfections):
    def worn(record, seed):
        return gb.imperfect(record, imperfections, channels=["outlet", "wall"], seed=seed)

    healthy = [plant(6000, seed) for seed in range(9)]
    perfect = calibrate(healthy, bank=bank())
    used_to_it = calibrate([worn(one, seed) for seed, one in enumerate(healthy)], bank=bank())
    fresh = [worn(plant(6000, 50 + seed), 50 + seed) for seed in range(6)]
    # lag and quantum colour what is left of the noise, which is learnt; a bias that wanders isn't noise
    assert (false_alarms(perfect, fresh) > 0) == (imperfections.wander > 0.0)
    assert false_alarms(used_to_it, fresh) == 0


def test_a_turn_on_bias_needs_no_calibration():
    biased = gb.imperfect(plant(6000, 60), gb.Imperfections(bias=50.0), channels=["outlet", "wall"], seed=3)
    assert false_alarms(calibrate([plant(6000, seed) for seed in range(6)], bank=bank()), [biased]) == 0


# what is refused


@pytest.mark.parametrize("samples", [0, 1, 3, 19, 20, 60])
def test_records_too_short_are_refused_in_a_line(samples):
    for records in (plant(samples, 1), [plant(samples, 1), plant(6000, 2)]):
        with pytest.raises(InputError) as refusal:
            calibrate(records, bank=bank())
        assert "\n" not in str(refusal.value)


@pytest.mark.nightly
def test_a_bank_may_be_named():
    records = [made_up(3000, seed) for seed in (1, 2)]
    assert calibrate(records, bank="C").thresholds == calibrate(records, bank=gb.load_bank("C")).thresholds
    with pytest.raises(InputError, match="no bank"):
        calibrate(records, bank="Q")


def test_missing_channels_are_named():
    record = plant(1000, 1)
    with pytest.raises(InputError, match="bank toy needs outlet, wall, inlet, and wall isn't there"):
        calibrate([record, record.select(["inlet", "outlet"])], bank=bank())
    with pytest.raises(InputError, match="isn't there"):
        watch(calibrate([plant(6000, seed) for seed in range(2)], bank=bank()), record.select(["inlet"]))


def test_records_of_two_sample_periods_are_refused():
    with pytest.raises(InputError, match=r"0.04, 0.1 s"):
        calibrate([plant(1000, 1), plant(1000, 2, 0.04)], bank=bank())
    monitor = calibrate([plant(6000, seed) for seed in range(2)], bank=bank())
    with pytest.raises(InputError, match=r"sampled every 0.04 s, the monitor was calibrated at 0.1 s"):
        watch(monitor, plant(1000, 2, 0.04))


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf, "1", 1e4])
def test_a_rate_that_cant_be_meant_is_refused(rate):
    with pytest.raises(InputError, match="false_alarms_per_hour"):
        calibrate([plant(1000, 1)], bank=bank(), false_alarms_per_hour=rate)


@pytest.mark.parametrize("records", [1, 3])  # of ten minutes; one is cut to little
def test_a_record_with_a_pseudo_input_of_its_own_is_watched_as_it_was_learnt(records):
    # somebody's own column phi_rate, in other hands than ours: what the bank says is derived, always
    def record(seed):
        rng = np.random.default_rng(seed)
        phi = np.convolve(rng.standard_normal(6100), np.hanning(30), mode="same")[:6000]
        p = np.gradient(phi, 0.1) + 0.1 * rng.standard_normal(6000)
        return Record(
            np.column_stack([p, phi, rng.standard_normal(6000)]), channels=["p", "phi", "phi_rate"], sample_period_s=0.1
        )

    used = bank_of("own", {"residuals": [{"output": "p", "inputs": ["phi_rate"]}]})
    healthy = [record(seed) for seed in range(records)]
    monitor = calibrate(healthy if records > 1 else healthy[0].between(0.0, 100.0), bank=used)
    raw = bank_residuals(monitor, record(7)).raw["p"]
    assert np.nanstd(raw) == pytest.approx(0.1, rel=0.1)
