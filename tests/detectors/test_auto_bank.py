"""Bank auto: which relations it takes, whom it suspects, what it tells apart; on logs, in files, as a command."""

import json
import math
from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.bank.bank import bank_of, bank_table, load_bank
from gtmbench.detectors.bank.composed import composed_bank, unwatched
from gtmbench.detectors.bank.detectability import BY_SHAPE, NOT_TOLD, isolability
from gtmbench.detectors.bank_detector import AutoDetector
from gtmbench.detectors.statistics.statistic import Statistic
from gtmbench.files.shipped import shipped_banks
from gtmbench.intake.contents import log_contents
from gtmbench.log.opening.auto_bank import bank_for_logs
from gtmbench.log.opening.driven_attitude import origin_in_logs
from gtmbench.method.estimators.bayesian import Bayesian
from gtmbench.testing.contract.subject import contract_case
from gtmbench.testing.contract.suite import CONTRACT, check_property
from gtmbench.values.channels import GYROS
from tests.helpers.intake_files import dataflash_text
from tests.helpers.monitors import record
from tests.helpers.night import by_day

ALL = ("p", "q", "r", "phi", "theta", "psi", "alpha", "beta", "tas", "ny", "nz")
NO_HEADING = ("p", "q", "r", "phi", "theta")
AIR = (*NO_HEADING, "alpha", "beta", "tas", "ny", "nz")


def relations(bank):
    return {spec.output: spec.inputs for spec in bank.residuals}


# --- which relations


def test_with_a_whole_attitude_it_is_bank_c_and_without_heading_bank_b():
    for channels, name in ((ALL, "C"), (AIR, "B")):
        composed, shipped = composed_bank(channels), load_bank(name)
        assert bank_table(composed) | {"title": ""} == bank_table(shipped) | {"title": ""}


def test_without_air_data_bank_bs_kinematics_are_judged_over_bank_cs_windows():
    bank = composed_bank(NO_HEADING)
    assert relations(bank) == {"p": ("p_turn",), "q": ("q_turn",)}
    assert bank.statistic == load_bank("C").statistic != load_bank("B").statistic
    assert bank.suspects == ("p", "q", "r", "phi", "theta")


def test_of_any_channels_each_gyro_has_the_first_relation_that_they_hold_or_a_reason_why_none():
    choices = [spec for name in ("C", "B") for spec in load_bank(name).residuals]
    for count in range(len(ALL) + 1):
        for there in combinations(ALL, count):
            held = {}
            for spec in choices:
                if spec.needs <= set(there):
                    held.setdefault(spec.output, spec.inputs)
            if not held:
                with pytest.raises(gb.InputError, match=r"bank auto (finds nothing|watches gyros)"):
                    composed_bank(there)
                continue
            bank = composed_bank(there)
            assert relations(bank) == held
            assert set(bank.suspects) == {name for spec in bank.residuals for name in spec.needs} & set(ALL[:6])
            assert bank_of("auto", bank_table(bank)) == bank
            assert list(unwatched(bank, there)) == [name for name in GYROS if name not in held]


def test_why_a_gyro_isnt_watched_is_what_would_let_it_be():
    (why,) = unwatched(composed_bank(NO_HEADING), NO_HEADING).values()
    assert why == "r isn't watched by itself: that takes psi, or alpha, beta, ny, nz and tas beside it"
    for more in (["psi"], ["alpha", "beta", "ny", "nz", "tas"]):
        assert unwatched(composed_bank([*NO_HEADING, *more]), [*NO_HEADING, *more]) == {}
    assert unwatched(composed_bank(["p", "phi", "theta", "psi"]), ["p", "phi", "theta", "psi"]) == {
        "q": "q isn't watched: it isn't there",
        "r": "r isn't watched: it isn't there",
    }


def test_without_any_relation_one_line_says_what_is_there_and_what_is_needed():
    with pytest.raises(gb.InputError) as refused:
        composed_bank(["p", "q", "phi", "nx", "Motor #2"])
    said = str(refused.value)
    assert "\n" not in said
    assert "(found: p, q, phi, nx)" in said
    assert "for p that takes psi and theta, or r and theta" in said
    with pytest.raises(gb.InputError, match=r"none of p, q, r is there \(found: no sensor\)"):
        composed_bank([])


# --- what it tells apart


@pytest.mark.parametrize("name", shipped_banks())
def test_two_are_told_by_residuals_that_one_enters_and_the_other_doesnt(name):
    bank = load_bank(name)
    told = isolability(bank)
    for one, others in told.table().items():
        for other, how in others.items():
            between = set(bank.affects(one)) - set(bank.affects(other))
            assert set(how.split()) == between if between else how in (BY_SHAPE, NOT_TOLD)


def test_what_nothing_predicts_isnt_told_by_how_residuals_rise():
    told = isolability(composed_bank(NO_HEADING))
    assert told.predicted == {"p", "q", "phi", "theta"}
    assert told.told("p", "r") == told.told("phi", "r") == NOT_TOLD
    assert told.told("r", "p") == "q"
    assert told.told("p", "phi") == BY_SHAPE
    assert isolability(composed_bank(AIR)).predicted == {"p", "q", "r", "phi", "theta"}


@pytest.mark.parametrize(("fault", "channels"), [("r", NO_HEADING), ("phi", ("p", "phi", "theta", "psi"))])
def test_whom_nothing_predicts_is_never_taken_for_another(fault, channels):
    """r turns pitch and roll in a bank; phi with one gyro only: each alarms, and looks like p or q."""
    monitor = gb.calibrate(
        [flight().between(0.0, 40.0).select(channels)], bank=composed_bank(channels), estimator=Bayesian()
    )
    broken = gb.inject(flight().between(40.02, 80.0).select(channels), gb.Bias(channel=fault, onset_s=60.0, size=8.0))
    watch = monitor.watch(broken)
    assert watch.faults
    assert all(alarm.sensor is None for alarm in watch.faults)
    assert all(fault in alarm.candidates for alarm in watch.faults)


# --- as a detector, on logs and in files


@cache
def flight():
    return record(4001, seed=7)


def write(tmp_path, name="flight.csv", channels=ALL[:6], healthy=True):
    flown = flight() if healthy else gb.inject(flight(), gb.Drift(channel="q", onset_s=60.0, slope=1.0))
    gb.write_log(flown.select([each for each in channels if each in flown]), tmp_path / name)
    return tmp_path / name


@pytest.mark.parametrize("name", by_day(sorted(CONTRACT, key="detects".__ne__)))
def test_it_is_found_by_its_name_and_keeps_the_contract(name):
    assert gb.find_detector("auto") == AutoDetector()
    channels = [name for name in ALL[:6] if name in flight()]
    records = [record(6000, seed=seed).select(channels) for seed in (1, 2, 3)]
    late = record(2750, seed=4).select(channels)
    case = contract_case(
        "auto", [*records, late], fault=gb.Drift(channel="p", onset_s=46.0, slope=30.0, duration_s=3.0)
    )
    check_property(case, name)


@pytest.mark.nightly
def test_a_log_is_watched_as_by_the_bank_that_it_allows(tmp_path):
    path = write(tmp_path, healthy=False)
    auto, c = (gb.watch_log(path, name, healthy=[(0.0, 40.0)]) for name in ("auto", "C"))
    assert auto.monitor.name == "auto"
    assert [alarm.verdict for alarm in auto.alarms] == [alarm.verdict for alarm in c.alarms] == ["q failed"]
    assert [alarm.time_s for alarm in auto.alarms] == [alarm.time_s for alarm in c.alarms]


def test_what_healthy_logs_lack_isnt_asked_for(tmp_path):
    whole, less = write(tmp_path), write(tmp_path, "less.csv", NO_HEADING)
    detector, why = bank_for_logs([whole, less], ())
    assert relations(detector.bank) == {"p": ("p_turn",), "q": ("q_turn",)}
    assert len(why) == 1


def test_a_column_without_a_number_isnt_there(tmp_path):
    frame = flight().select(ALL[:6]).frame()
    frame["psi"] = np.nan
    path = tmp_path / "empty.csv"
    named = {name: f"{name}_deg_s" if name in GYROS else f"{name}_deg" for name in frame}
    frame.rename(columns=named).rename_axis("time_s").to_csv(path)
    assert "psi" not in log_contents(path).usable
    assert bank_for_logs([path], ())[0].bank.channels == ("p", "q", "phi", "r", "theta")


def test_an_autopilots_attitude_comes_from_its_gyros_and_a_tables_may_not(tmp_path):
    path = tmp_path / "flight.log"
    moving = [(20_000 * k, *(0.1 * math.sin(0.1 * k + i) for i in range(3))) for k in range(300)]
    tables = {"IMU": "GyrX,GyrY,GyrZ", "ATT": "Roll,Pitch,Yaw"}
    path.write_bytes(dataflash_text({kind: ("Qfff", f"TimeUS,{names}", moving) for kind, names in tables.items()}))
    assert log_contents(path).attitude_from_gyros
    assert bank_for_logs([path], ())[0].bank.attitude_from_gyros
    columns = [f"{name}=ATT.{angle}:deg" for name, angle in (("phi", "Roll"), ("theta", "Pitch"), ("psi", "Yaw"))]
    assert not log_contents(path, mapping=columns).attitude_from_gyros
    table = write(tmp_path)
    assert not log_contents(table).attitude_from_gyros
    assert bank_for_logs([table], ())[0].bank.attitude_from_gyros  # at 50 Hz nothing shows that it is of its own
    told = origin_in_logs([table], attitude="own")
    assert not bank_for_logs([table], (), told)[0].bank.attitude_from_gyros


@pytest.mark.nightly
def test_a_saved_monitor_is_read_and_shown(tmp_path, cli):
    write(tmp_path, channels=NO_HEADING)
    code, out, err = cli("monitor", "flight.csv", "--healthy", "0:40", "--details")
    assert (code, err) == (3, "")  # nothing but the bank judges p and q of a log without a heading
    assert "bank auto: p and q from phi, r and theta, as bank B" in out
    assert "isolable by which residuals rise: p (p), q (q), r, phi and theta (p and q)" in out
    assert "not isolable: p, q, phi and theta from r, because nothing predicts r" in out
    assert "note: r isn't watched by itself: that takes psi" in out
    assert any(line.startswith("Not watched  r isn't watched by itself: ") for line in out.splitlines())
    taught = cli("calibrate", "flight.csv", "--detector", "auto", "--healthy", "0:40", "--out", "m.json")
    assert (taught[0], taught[2]) == (0, "")
    assert taught[1].startswith("Calibrated bank auto on 40 s of flight.csv: m.json.\n")
    monitor = gb.load_monitor(tmp_path / "m.json")
    assert replace(monitor.bank, statistic=Statistic()) == composed_bank(NO_HEADING, attitude_from_gyros=True)
    gb.save_monitor(monitor, tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "m.json").read_bytes()
    code, out, _ = cli("list", "m.json", "--json")
    printed = json.loads(out)
    assert (code, printed["name"], printed["told_apart"]["p"]["r"]) == (0, "auto", "no")
    assert cli("monitor", "flight.csv", "--detector", "m.json", "-q")[0] != 1
    assert cli("calibrate", "flight.csv", "--detector", "auto", "--out", "c.json", "-q") == (0, "", "")
    assert relations(gb.load_monitor(tmp_path / "c.json").bank) == relations(monitor.bank)


def test_auto_is_shown_for_a_log(tmp_path, cli):
    write(tmp_path)
    assert "bank auto: possible" in cli("monitor", "flight.csv", "--list")[1]
    code, out, err = cli("list", "auto")
    assert (code, out) == (2, "")
    assert "bank auto is made of a log's channels" in err
    assert "auto" in json.loads(cli("list", "--json")[1])["detectors"]


def test_a_log_that_allows_nothing_is_bad_input_in_one_line(tmp_path, cli):
    write(tmp_path, channels=("p", "q", "r", "phi"))
    code, out, err = cli("monitor", "flight.csv", "--healthy", "0:40")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "flight.csv: bank auto finds nothing that tells what a gyro should read (found: p, q, r, phi)" in err
