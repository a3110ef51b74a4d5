"""Campaigns and studies with a magnetometer and a GPS: named where they break, refused where there are none."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.jobs.progress import counted, silent
from gtmbench.study.campaign.plan import load_campaign
from gtmbench.study.flights import fly_setup
from gtmbench.study.run import run_study
from gtmbench.study.scenario import load_scenario
from tests.helpers.campaigns import table, written
from tests.helpers.watching import spike

ONSET_S = 75.0
CAMPAIGN = """
title = "Other sensors"
detectors = ["cross-check"]
duration_s = 100
excitation = "multisine+turbulence"
noise = "t2"
attitude = "filter 20 s"
severity_reference_s = [10, 60]
[operator]
identify_s = [5, 50]
[alarm]
threshold_s = [50, 90]
watch_from_s = 5
healthy_records = 1
[magnetometer]
inclination_deg = 60
hard_iron_ut = [1.0, -1.0, 1.5]
[gps]
rate_hz = 5
delay_s = 0.12
[calibration]
flights = 2
duration_s = 120
seed = 2000000
[axes]
seed = 31
[[faults]]
kind = "jam"
channels = ["mag_x", "gps_down", "tas", "nz", "altitude"]
onset_s = 75
[[faults]]
kind = "bias"
channels = ["mag_x", "gps_down"]
onset_s = 75
size = 12
[[faults]]
kind = "bias"
channels = ["q"]
onset_s = 75
size = 3
"""


@pytest.mark.nightly
def test_it_finds_and_names_them_and_lays_no_gyros_fault_on_them(tmp_path):
    rows = table(tmp_path, CAMPAIGN)
    assert rows["error"].isna().all()
    own = rows[rows["fault"].notna() & (rows["channel"] != "q")]
    jams = own[own["fault"] == "jam"]
    assert jams["detected"].all()
    assert jams["isolated"].all()
    assert jams["axis_right"].all()
    assert not rows["named_wrong"].fillna(False).astype(bool).any()
    assert rows.loc[rows["channel"] == "q", "sensor"].isna().all()
    assert set(rows.loc[rows["channel"] == "mag_x", "unit"]) == {"uT"}
    assert (own["altered_share"] > 0.99).all()  # of the readings, of which a GPS has one in twenty rows
    healthy = rows[rows["fault"].isna()]
    assert (healthy["false_alarms"].sum(), len(healthy)) == (0, 1)
    assert healthy["armed_hours"].tolist() == pytest.approx([95.0 / 3600.0], rel=0.02)


def test_a_campaign_without_them_states_nothing_of_them(tmp_path):
    plain = CAMPAIGN.replace('"mag_x", "gps_down", ', "").replace('"mag_x", "gps_down"', '"tas"')
    head, rest = plain.split("[magnetometer]")
    bare = written(tmp_path, head + rest[rest.index("[calibration]") :], "bare")
    facts = load_campaign(bare).facts()
    assert "gps" not in facts["scenarios"]["bare"]["setup"]
    assert "gps" not in facts["calibration"]
    told = load_campaign(written(tmp_path, CAMPAIGN)).facts()
    assert told["calibration"]["gps"]["delay_s"] == 0.12
    assert told["calibration"]["magnetometer"]["iron_seed"] == 1


@pytest.mark.nightly
def test_in_the_loop_they_read_the_flight_that_the_autopilot_flies(tmp_path):
    text = CAMPAIGN.replace("[alarm]", "[autopilot]\n[alarm]").replace('attitude = "filter 20 s"\n', "")
    path = written(tmp_path, text.replace("size = 3", "size = 0.3"), "loop")
    scenario = _scenario_of(path)
    tried = ("jam", "gps_down"), ("jam", "mag_x"), ("bias", "q")
    scenario = replace(scenario, faults=tuple(each for each in scenario.faults if (each.kind, each.channel) in tried))
    loop = fly_setup(scenario.setup, False, counted(silent, 2))
    others = [loop.elsewhere("multisine+turbulence", 100.0, seed, seed) for seed in (201, 202)]
    study = run_study([scenario], detectors=[gb.CrossCheck().calibrate(others)])
    by_channel = {(trial.channel, trial.fault): trial for trial in study.trials}
    assert by_channel["gps_down", "jam"].isolated
    assert by_channel["mag_x", "jam"].isolated
    assert by_channel["mag_x", "jam"].events[0].kind == "out of loop"
    assert by_channel["q", "bias"].sensor is None
    jammed, healthy = by_channel["gps_down", "jam"], study.baseline.healthy
    before = jammed.record.time_s < ONSET_S
    np.testing.assert_array_equal(jammed.record["gps_down"][before], healthy["gps_down"][before])
    down_m_s = -np.gradient(study.baseline.flight["altitude"] * 0.3048, 0.01)
    np.testing.assert_allclose(study.baseline.flight["gps_down"], down_m_s, atol=1e-9)


def _scenario_of(path):
    """Return the scenario of a campaign's file."""
    (scenario,) = load_campaign(path).scenarios
    return scenario


def test_a_share_is_of_what_a_perfect_sensor_reads(tmp_path):
    text = CAMPAIGN.replace("size = 12", 'size = "50 % of rms"')
    scenario = _scenario_of(written(tmp_path, text, "shares"))
    (trial,) = [
        each
        for each in run_study([scenario], detectors=[gb.FunctionDetector(spike)]).trials
        if (each.channel, each.fault) == ("mag_x", "bias")
    ]
    truth = trial.flight["mag_x"][1000:6000]
    assert trial.severity["size"] == pytest.approx(0.5 * truth.std(), rel=1e-3)
    healthy = trial.baseline.healthy["mag_x"]
    assert np.nanstd(healthy - trial.flight["mag_x"]) == pytest.approx(0.25, rel=0.1)  # 0.5 % of the field


def test_what_is_expected_of_a_sensor_of_several_channels_may_be_stated(tmp_path):
    table_ = '\n[faults.expect.cross-check]\nisolate_as = "sensor"\n'
    text = CAMPAIGN.replace('"mag_x", "gps_down", "tas", "nz", "altitude"', '"mag_x", "p"').replace(
        "onset_s = 75\n[[faults]]", f"onset_s = 75{table_}[[faults]]", 1
    )
    first, second, *_ = _scenario_of(written(tmp_path, text, "expect")).faults
    assert first.expect["cross-check"].isolate_as == ("magnetometer",)
    assert second.expect["cross-check"].isolate_as == ("p",)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("rate_hz = 5", "rate_hz = 500", "gps: rate_hz is 500; it must be"),
        ("rate_hz = 5", "rates = 5", "unknown key 'rates' in \\[gps\\]; there are rate_hz, delay_s"),
        ("[1.0, -1.0, 1.5]", "[1.0]", "magnetometer: hard_iron_ut is \\(1.0,\\); give three numbers"),
        ("delay_s = 0.12", "delay_s = -1", "gps: delay_s is -1; it must be"),
        ("inclination_deg = 60", "field_per_ampere_ut = [1, 1, 1]", "unknown key 'field_per_ampere_ut'"),
        ("[gps]\nrate_hz = 5\ndelay_s = 0.12\n", "", "jam of gps_down, from 75 s: the flight has no 'gps_down'; add"),
        ('channels = ["q"]', 'channels = ["mag_w"]', "no channel that can break is 'mag_w'"),
    ],
)
def test_a_bad_table_ends_in_one_line_before_anything_is_flown(tmp_path, old, new, said):
    assert old in CAMPAIGN
    with pytest.raises(gb.InputError, match=said) as told:
        load_campaign(written(tmp_path, CAMPAIGN.replace(old, new)))
    assert "\n" not in str(told.value)


def test_a_search_for_what_no_flight_has_and_scenarios_of_two_receivers_are_refused(tmp_path):
    search = '[[smallest]]\nkind = "bias"\nchannels = ["gps_north"]\nonset_s = 75\nsize = [1, 9]\n'
    head, rest = CAMPAIGN.split("[magnetometer]")
    text = head + rest[rest.index("[calibration]") : rest.index("[[faults]]")] + search
    with pytest.raises(gb.InputError, match="the flight has no 'gps_north'"):
        load_campaign(written(tmp_path, text))
    faults = CAMPAIGN[CAMPAIGN.index("[[faults]]") :]
    lone = head.replace('detectors = ["cross-check"]\n', "")
    for name, rate_hz in (("one", 5), ("two", 10)):
        written(tmp_path, f"{lone}[magnetometer]\n[gps]\nrate_hz = {rate_hz}\n{faults}", name)
    both = f'scenarios = ["{tmp_path}/one.toml", "{tmp_path}/two.toml"]\n'
    with pytest.raises(gb.InputError, match=r"\[gps\] or \[magnetometer\] differ in its scenarios"):
        load_campaign(written(tmp_path, both, "both"))


def test_a_fault_of_python_wants_the_sensor_too():
    with pytest.raises(gb.InputError, match=r"the flight has no 'gps_east'; add a table \[gps\]"):
        gb.run("jam", faults=[gb.Bias(channel="gps_east", onset_s=300.0, size=1.0)])
    scenario = load_scenario("jam")
    with pytest.raises(gb.InputError, match="mag_x"):
        replace(scenario, faults=(replace(scenario.faults[0], fault=gb.Jam(channel="mag_x", onset_s=300.0)),))
