"""Searches for the smallest fault: what they find is where detection begins, by watching; one line for bad input."""

from dataclasses import replace

import pytest

from gtmbench.detectors.base import FunctionDetector
from gtmbench.errors import InputError
from gtmbench.faults.fault import inject
from gtmbench.jobs.progress import counted, silent
from gtmbench.study.campaign.searches import first_detected, search_row, searches_of
from gtmbench.study.flights import fly_setup
from tests.helpers.campaigns import loaded
from tests.helpers.night import by_day
from tests.helpers.watching import monitor
from tests.study.campaign.test_campaign import BROKEN

SEARCH = {"kind": "bias", "channels": ["q"], "onset_s": 60.0, "size": [0.01, 100.0], "within_s": 20.0}


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    (task,) = loaded(tmp_path_factory.mktemp("flown"), BROKEN).tasks()
    return fly_setup(task.setup, False, counted(silent, 2))


@pytest.mark.parametrize(
    "table",
    by_day(
        [
            SEARCH,
            {"kind": "deadzone", "channels": ["p"], "onset_s": 60.0, "half_width": ["1 % of rms", "300 % of rms"]},
            {"kind": "saturation", "channels": ["r"], "onset_s": 60.0, "limit": ["100 % of peak", "1 % of peak"]},
        ]
    ),
    ids=lambda table: table["kind"],
)
def test_what_is_found_is_detected_by_watching_and_a_milder_fault_isnt(flown, table):
    (search,) = searches_of([table], 120.0)
    healthy = flown.sensed(2).between(5.0, 119.0)
    row = search_row(search, flown, monitor().watch(healthy))
    assert row["detected"]
    mildest, severest = (bound.value for bound in search.bounds)
    assert min(mildest, severest) < row["smallest"] < max(mildest, severest)
    milder = row["smallest"] * (1.06 if severest < mildest else 1 / 1.06)
    reference = flown.flight.between(*flown.setup.severity_reference_s)
    until_s = 60.0 + (search.within_s or 100.0)
    for severity, is_detected in [(row["smallest"], True), (milder, False)]:
        watch = monitor().watch(inject(healthy, search.fault(severity, reference)))
        assert any(60.0 <= alarm.time_s <= until_s for alarm in watch.alarms) == is_detected


def test_of_a_share_the_figure_is_what_it_comes_to_on_the_flight(flown):
    (search,) = searches_of([{**SEARCH, "size": ["1 % of rms", "400 % of rms"]}], 120.0)
    row = search_row(search, flown, monitor().watch(flown.sensed(2).between(5.0, 119.0)))
    q = flown.flight.between(*flown.setup.severity_reference_s)["q"]
    assert row["severity"] == pytest.approx(row["smallest"] * q.std())


def test_nothing_found_is_no_figure_and_whoever_alarms_anyway_isnt_asked(flown):
    healthy = flown.sensed(2)
    (search,) = searches_of([{**SEARCH, "size": [1e-9, 1e-6]}], 120.0)
    row = search_row(search, flown, monitor().watch(healthy))
    assert not row["detected"]
    assert "smallest" not in row
    always = FunctionDetector(lambda record: record.time_s[::100], name="always").calibrate()
    assert "detected" not in search_row(search, flown, always.watch(healthy))


@pytest.mark.parametrize(("bounds", "truth"), [((0.01, 100.0), 0.37), ((100.0, 0.01), 3.0), ((-0.01, -100.0), -5.0)])
def test_bisection_ends_within_a_twentieth_whichever_way_is_severer(bounds, truth):
    severer = (lambda x: abs(x) >= abs(truth)) if abs(bounds[1]) > abs(bounds[0]) else (lambda x: x <= truth)
    found = first_detected(severer, *bounds)
    assert severer(found)
    assert 1 / 1.05 <= found / truth <= 1.05


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"size": 0.3}, "give one severity of size as two"),
        ({"size": [0.1, 0.2, 0.3]}, "as two, the mildest and the severest"),
        ({"size": [0.0, 1.0]}, "can't be halved in ratios"),
        ({"size": [-1.0, 1.0]}, "can't be halved in ratios"),
        ({"size": [1.0, 1.0]}, "can't be halved in ratios"),
        ({"size": [1.0, "50 % of rms"]}, "both as figures or as shares"),
        ({"within_s": 0.0}, "within_s is 0"),
        ({"also": []}, "also can't stand in a search"),
        ({"onset_s": 500.0}, "onset_s is 500"),
        ({"kind": "jam"}, "no severity is a list"),
        ({"chanels": ["p"]}, "chanels"),
    ],
)
def test_what_cant_be_meant_is_one_line(change, said):
    with pytest.raises(InputError, match=said) as refused:
        searches_of([SEARCH | change], 120.0)
    assert "smallest 1" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_searches_count_in_the_plan_and_in_what_a_run_hangs_on(tmp_path):
    text = BROKEN + '[[smallest]]\nkind = "bias"\nchannels = ["p", "q"]\nonset_s = 60\nsize = [0.01, 100]\n'
    campaign = loaded(tmp_path, text)
    (task,) = campaign.tasks()
    assert campaign.searches_made == len(task.searches) == 2
    assert campaign.search_trials == 2 * campaign.searches[0].trials
    assert campaign.facts() != replace(campaign, searches=campaign.searches[:1]).facts()
