"""The certificate of a watched log, held against faults that are really put on the record, and watched."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.bank.bank import bank_of
from gtmbench.detectors.monitor.scores import bank_alarms
from gtmbench.log.judging.certificate import SHARE, Certificate, SmallestSeen, certificate_of, kinds
from gtmbench.log.judging.claims import of_certificate
from gtmbench.report.fleet import fleet_row
from gtmbench.report.tables.log import log_results
from gtmbench.report.words.found import certificate_lines, certificate_text
from gtmbench.report.words.log import log_report
from gtmbench.verdict.scope import Scope
from gtmbench.verdict.timeline import State, laid_out
from gtmbench.verdict.verdict import verdict_of
from tests.helpers.logged import jammed, never_armed, normed, short, silent, unwatched
from tests.helpers.monitors import monitor, record
from tests.helpers.night import by_day

KIND = {kind.fault.kind: kind for kind in kinds()}


@cache
def flight():
    """Return two minutes with a hole in p, and what the monitor said."""
    whole = record(6000, seed=61)
    return monitor().watch(whole.replace("p", np.where(np.abs(whole.time_s - 70.0) < 0.3, np.nan, whole["p"])))


@cache
def certificate():
    return certificate_of(monitor(), [flight()])


def alarmed(watch, fault, within_s):
    """Tell whether the sensor's residual crosses its threshold in time where it is armed, by brute force."""
    return any(
        crossing.output == fault.channel and fault.onset_s <= crossing.time_s <= fault.onset_s + within_s + 1e-6
        for crossing in bank_alarms(watch.monitor, gb.inject(watch.record, fault))
    )


def trials(kind, sensor, size, count, seed):
    """Return faults of a size at onsets drawn from when its residual is armed, which leaves time to alarm."""
    random, watch = np.random.default_rng(seed), flight()
    able_s = watch.record.time_s[watch.monitor.superposition(watch, sensor).armed]
    able_s = able_s[able_s < watch.record.end_s - KIND[kind].within_s]
    return [
        KIND[kind].at(sensor, float(onset_s), size, is_turned=bool(random.integers(2)))
        for onset_s in random.choice(able_s, count)
    ]


pytestmark = pytest.mark.usefixtures("whole_certificates")


@pytest.mark.parametrize("kind", by_day(KIND))
@pytest.mark.parametrize("sensor", by_day(["p", "r"]))
def test_a_fault_alarms_by_superposition_where_it_does_when_it_is_put_on_the_record(sensor, kind):
    watch, row = flight(), certificate().of(sensor, kind)
    on = watch.monitor.superposition(watch, sensor)
    several = [
        fault
        for times in (0.4, 0.7, 1.0, 2.0)
        for fault in trials(kind, sensor, times * row.size, 3, seed=int(10 * times))
    ]
    said = [on.alarm_row(fault, row.within_s) is not None for fault in several]
    assert said == [alarmed(watch, fault, row.within_s) for fault in several]
    assert 0 < sum(said) < len(said)


def share(kind, times, count):
    """Return how often a fault is seen that is so many times as large as is certified."""
    several = trials(kind, "q", times * certificate().of("q", kind).size, count, seed=5)
    return np.mean([alarmed(flight(), fault, KIND[kind].within_s) for fault in several])


@pytest.mark.parametrize("kind", by_day(KIND))
def test_a_size_is_seen_in_nine_tenths_of_the_time_and_three_times_as_much_always(kind):
    row = certificate().of("q", kind)
    assert SHARE <= row.share <= 1.0
    assert share(kind, 1.0, 40) > 0.75  # 36 of 40 expected, and 20 onsets tell a quantile within some percent
    assert share(kind, 3.0, 10) == 1.0


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KIND)
def test_half_of_a_size_is_seen_rarely(kind):
    assert share(kind, 0.5, 40) < 0.7  # of ten, seven by luck


def test_every_gyro_and_kind_has_its_row_and_more_noise_is_needed_where_there_is_more():
    """p and q have 0.5 deg/s of noise, r has 0.3."""
    rows = certificate().rows
    assert [(row.sensor, row.kind) for row in rows] == [(sensor, kind) for sensor in "pqr" for kind in KIND]
    noise = {sensor: certificate().of(sensor, "noise").size for sensor in "pqr"}
    assert noise["r"] < 0.9 * min(noise["p"], noise["q"])
    assert certificate().watched_s == pytest.approx(3600.0 * flight().armed_hours)


@pytest.mark.parametrize("sensor", ["p", "q", "r"])
def test_silence_proves_nothing_where_the_smallest_bias_is_above_the_limit(sensor):
    """The timeline has the certificate's own size, within which time a fault shows, and the verdict asks for it."""
    watch, row = flight(), certificate().of(sensor, "bias")
    claims = {name: [span for other, span in of_certificate(certificate(), [watch]) if other == name] for name in "pqr"}
    timeline = laid_out((0.0, watch.record.end_s), claims, motion_s=[(30.0, 60.0)])
    for times, state, exit_code in ((0.99, State.NOT_JUDGED, 3), (1.01, State.CLEAR, 0)):
        said = verdict_of(timeline, Scope(sensors=(sensor,), error_deg_s=times * row.size))
        span = said.timeline.at(sensor, 45.0)
        assert (span.state, span.sizes.error, span.sizes.within_s) == (state, row.size, row.within_s)
        assert said.exit_code == exit_code
    unsized = Certificate(rows=tuple(each for each in certificate().rows if each.sensor != sensor), watched_s=60.0)
    assert sensor not in {name for name, _ in of_certificate(unsized, [watch])}


@pytest.mark.nightly
def test_another_start_changes_nothing():
    part = flight().record.between(0.0, 80.0)
    later = gb.Record(part.values, channels=part.channels, sample_period_s=part.sample_period_s, start_s=1000.0)
    ours, theirs = (certificate_of(monitor(), [monitor().watch(each)]) for each in (part, later))
    for row, other in zip(ours.rows, theirs.rows, strict=True):
        assert (row.sensor, row.kind, row.share) == (other.sensor, other.kind, other.share)
        assert row.size == pytest.approx(other.size, rel=1e-6)


@pytest.mark.nightly
def test_another_unit_scales_sizes():
    noise = np.random.default_rng(7).standard_normal((4000, 2))
    values = noise @ [[1.0, 1.0], [0.0, 0.1]]
    rows = []
    for factor in (1.0, 1024.0):
        both = gb.Record(values * [1.0, factor], channels=["in", "out"], sample_period_s=0.04)
        bank = bank_of("own", {"residuals": [{"output": "out", "inputs": ["in"]}]})
        own = gb.calibrate([both.between(0.0, 80.0)], bank=bank)
        rows.append(certificate_of(own, [own.watch(both.between(80.04, 159.0))]).rows)
    for row, other in zip(*rows, strict=True):
        factor = 1.0 if row.kind == "scale_factor" else 1024.0
        assert other.size == pytest.approx(factor * row.size, rel=1e-6)


def test_nothing_is_certified_where_no_alarm_was_possible_or_nothing_says_how_scores_change():
    for case, why in (
        (unwatched, "at no time was an alarm possible"),
        (never_armed, "at no time was an alarm possible"),
        (normed, "is no bank"),
        (silent, "is no bank"),
    ):
        said = case().certificate
        assert (said.rows, certificate_lines(said)) == ((), [])
        assert why in said.missing
    told = certificate_text(silent().certificate)
    assert told.startswith("Nobody can tell which faults would have been detected: nothing is no bank")


def test_nothing_is_certified_of_a_log_that_was_watched_for_some_samples_only():
    few = np.arange(len(flight().record)) < np.argmax(flight().armed) + 3
    scores = {name: replace(score, armed=score.armed & few) for name, score in flight().scores.items()}
    watch = replace(flight(), scores=scores)
    assert np.count_nonzero(watch.armed) == 3
    said = certificate_of(monitor(), [watch])
    assert (said.rows, said.missing) == ((), "too little of it was watched")


@pytest.mark.nightly
def test_a_sensor_that_is_no_longer_watched_isnt_seen():
    """q is jammed at 170 s of 146.5..239 s, and stays disarmed; p isn't touched by that."""
    watch = jammed().watches[1]
    said = certificate_of(watch.monitor, [watch])
    assert all(said.of("q", kind).size is None for kind in KIND)
    assert all(said.of("q", kind).share < 0.3 for kind in KIND)
    assert all(said.of("p", kind).size is not None for kind in KIND)


def test_of_a_gyro_that_reads_nothing_no_scale_and_no_deadzone_is_seen_but_a_bias_is():
    still = replace(flight().monitor.superposition(flight(), "r"), record=flight().record.replace("r", np.zeros(6000)))
    for kind, size, is_seen in (("scale_factor", 2.0, False), ("deadzone", 50.0, False), ("bias", 1.0, True)):
        fault = KIND[kind].at("r", 60.0, size, is_turned=True)
        assert (still.alarm_row(fault, 10.0) is not None) == is_seen


@pytest.mark.nightly
def test_what_is_named_is_named_when_it_is_watched(monkeypatch):
    monkeypatch.setattr("gtmbench.log.judging.certificate.kinds", lambda: (KIND["bias"], KIND["deadzone"]))
    watch = monitor().watch(record(4000, seed=62).between(0.0, 79.0))
    said = certificate_of(monitor(), [watch], named=True)
    assert said.is_named
    told = [row for row in said.rows if row.named_from is not None]
    assert len(told) > len(said.rows) / 2
    assert all(row.size <= row.named_from <= 5.0 * row.size for row in told)
    for row in told[::2]:
        fault = KIND[row.kind].at(row.sensor, 45.0, 2.0 * row.named_from, is_turned=False)
        assert [alarm.sensor for alarm in monitor().watch(gb.inject(watch.record, fault)).faults] == [row.sensor]


def test_the_report_holds_it_in_words_and_numbers(monkeypatch):
    monkeypatch.setattr("gtmbench.log.judging.certificate.ONSETS", 3)
    watched, said = short(), short().certificate
    assert fleet_row(watched)["certificate"] == certificate_text(said)
    lines = log_report(watched)
    assert set(certificate_lines(said)) <= set(lines)
    results = log_results(watched)["certificate"]
    assert [(row["sensor"], row["kind"], row["size"]) for row in results["rows"]] == [
        (row.sensor, row.kind, row.size) for row in said.rows
    ]
    assert [row["unit"] for row in results["rows"][:5]] == ["deg/s", "deg/s²", "", "deg/s", "deg/s"]
    assert not results["is_named"]


@pytest.mark.nightly
def test_with_names_asks_for_them(monkeypatch):
    monkeypatch.setattr("gtmbench.log.judging.certificate.kinds", lambda: (KIND["bias"],))
    assert not short().certificate.is_named
    assert short().with_names().certificate.is_named


def row(sensor, size, kind="bias", within_s=10.0, **more):
    return SmallestSeen(sensor=sensor, kind=kind, size=size, share=0.9 if size else 0.45, within_s=within_s, **more)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (
            [row("p", 0.532), row("r", 123.4)],
            "A bias above p 0.53, r 120 deg/s would have been detected within 10 s (at 90 % of start times).",
        ),
        (
            [row("p", 2.0), row("r", None)],
            "A bias above p 2 deg/s would have been detected within 10 s (at 90 % of start times); none of r.",
        ),
        (
            [row("p", 2.0), row("q", 0.5, within_s=60.0), row("r", None, within_s=90.0)],
            "A bias above p 2, q 0.5 deg/s would have been detected within 60 s (at 90 % of start times); none of r.",
        ),
        (
            [row("p", None), row("r", None)],
            "No bias of p or r, however large, would have been detected within 10 s (at 90 % of start times).",
        ),
    ],
)
def test_the_headline_says_which_sensors_are_blind(rows, said):
    assert certificate_text(Certificate(rows=tuple(rows), watched_s=60.0)) == said


def test_a_gyro_whose_end_would_go_unseen_is_told():
    rows = (row("p", None, "deadzone"), row("q", 0.5, "deadzone"), row("r", None, "deadzone"))
    told = certificate_lines(Certificate(rows=rows, watched_s=60.0))[-1]
    assert told == "  A dead p or r would not have been detected at 90 % of start times"


def test_the_table_says_of_each_kind_the_longest_time_that_a_sensor_takes():
    rows = (row("p", 2.0), row("p", 1.0, "noise"), row("q", 0.5, within_s=60.0), row("q", 1.0, "noise"))
    title = certificate_lines(Certificate(rows=rows, watched_s=60.0))[0]
    assert title.startswith("Smallest faults that would have been detected within 10 s (bias 60 s), at 90 %")


def test_the_table_says_how_often_the_largest_would_have_been_seen_and_what_is_named():
    rows = (row("p", 0.532, named_from=1.6), row("p", None, "scale_factor"))
    assert certificate_lines(Certificate(rows=rows, watched_s=60.0, is_named=True)) == [
        "Smallest faults that would have been detected within 10 s, at 90 % of start times in the 60.0 s watched:",
        "           bias        scale error",
        "  p        0.53 deg/s  in 45 %",
        "    named  1.6 deg/s   -",
        "  in ... %: even the largest fault tried would have been detected this rarely",
    ]
