"""`gtmbench calibrate` and `gtmbench list BANK`: what they write and print, and bad input that costs no long work."""

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.sensors import drawn
from gtmbench.detectors.statistics.thresholds import HealthyMaxima, Luck
from gtmbench.files.shipped import shipped_banks
from gtmbench.study.healthy_records import CalibrationFlights, logged_records
from tests.helpers.hostile import refused
from tests.helpers.monitors import monitor, record
from tests.helpers.sealed import resealed

SHORT = ("--flights", 2, "--duration", 40)


@pytest.fixture(autouse=True)
def one_processor(monkeypatch):
    """Flights are flown in turn."""
    monkeypatch.setattr("os.cpu_count", lambda: 1)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Write three logs, and some that can't be calibrated on with them; return their folder."""
    folder = tmp_path_factory.mktemp("logs")
    for seed in (1, 2, 3):
        gb.write_log(record(3000, seed=seed), folder / f"log{seed}.csv")
    gb.write_log(record(3000, period_s=0.05), folder / "slow.csv")
    gb.write_log(record(3000, seed=4).select(["p", "q", "r", "beta"]), folder / "gyros.csv")
    gb.write_log(record(15), folder / "short.csv")
    gb.write_log(record(60), folder / "brief.csv")
    return folder


@pytest.fixture
def logs(written, tmp_path):
    """Lay three logs there and return their names."""
    return [shutil.copy(path, tmp_path) and path.name for path in sorted(written.glob("log?.csv"))]


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.nightly
def test_without_logs_it_flies_and_writes_what_python_calibrates(cli, tmp_path):
    code, out, err = cli("calibrate", *SHORT, "--seed", 5, "--tolerate", "bias=0.5,lag=0.005")
    assert (code, err) == (0, "")
    assert "2 flights of gtm, 40 s each, multisine+turbulence, noise t2, seeds 5 to 6" in out
    assert "imperfections of healthy gyros: bias 0.5, lag 0.005 s" in out
    assert "the 80.0 s that set the thresholds show no more than " in out
    assert names(tmp_path) == ["monitor.json"]

    imperfections = gb.Imperfections(bias=0.5, lag_s=0.005)
    flown = [
        gb.imperfect(
            gb.measure(gb.fly("gtm", "multisine+turbulence", 40.0, seed), noise="t2", seed=seed),
            drawn(imperfections, seed=seed),
            seed=seed,
        )
        for seed in (5, 6)
    ]
    flights = CalibrationFlights(flights=2, duration_s=40.0, seed=5, imperfections=imperfections)
    by_hand = gb.calibrate(flown, bank=gb.load_bank("C"), provenance=flights.provenance(), false_alarms_per_hour=0.002)
    gb.save_monitor(by_hand, "by_hand.json")
    assert (tmp_path / "by_hand.json").read_bytes() == (tmp_path / "monitor.json").read_bytes()


def test_it_says_what_thresholds_owe_to_luck(cli, logs):
    code, out, _ = cli("calibrate", *logs)
    assert code == 0
    luck = Luck.from_provenance(gb.load_monitor("monitor.json").provenance)
    assert f"others like them would move thresholds by a factor of {luck.median:.2g} (median)" in out
    assert f"{luck.within:.2g} (95 %)" in out
    assert f"{luck.within:.2g} (95 %)" in cli("list", "monitor.json")[1]


def test_thresholds_that_are_luck_are_refused_and_leave_nothing(cli, logs, tmp_path, monkeypatch):
    monkeypatch.setattr(HealthyMaxima, "luck", lambda *_: Luck(median=4.2, within=20.0))
    before = names(tmp_path)
    code, out, err = cli("calibrate", *logs)
    assert (code, out, names(tmp_path)) == (2, "", before)
    assert "3 other logs like these would set them 4.2 times as high or low, in the median; give about 7 logs" in err


def test_with_logs_it_reads_them_and_keeps_their_names_and_digests(cli, logs, tmp_path):
    code, out, err = cli("calibrate", *logs, "--detector", "paper", "--out", "p.json")
    assert (code, err) == (0, "")
    assert "calibrated on: log1.csv, log2.csv, log3.csv" in out
    assert "bank paper" in out
    provenance = gb.load_monitor("p.json").provenance
    assert [log["name"] for log in provenance["logs"]] == logs
    assert provenance["logs"][0]["sha256"] == hashlib.sha256((tmp_path / "log1.csv").read_bytes()).hexdigest()
    assert str(tmp_path) not in (tmp_path / "p.json").read_text()


def test_a_log_of_gtmbench_fly_will_do(cli, tmp_path):
    fly = ("fly", "--duration", 40, "--noise", "t2", "--excitation", "multisine+turbulence", "--out", "flight.parquet")
    assert cli(*fly)[0] == 0
    assert cli("calibrate", "flight.parquet", "-q") == (0, "", "")
    loaded = gb.load_monitor("monitor.json")
    assert gb.watch(loaded, gb.read_log("flight.parquet")).alarms == ()
    assert names(tmp_path) == ["flight.parquet", "monitor.json"]


def test_json_is_one_object_with_the_same_facts(cli, logs):
    code, out, err = cli("calibrate", *logs, "--json", "--false-alarms-per-hour", 0.5)
    printed = json.loads(out)
    assert (code, err) == (0, "")
    assert printed["out"] == "monitor.json"
    made = printed["monitor"]
    assert made["provenance"]["false_alarms_per_hour"] == 0.5
    assert made["residuals"]["q"]["inputs"] == ["q_att"]
    # of the gyro's 0.5 and the attitude's 0.02 deg: its rate has a gain of 1, no delay and no curvature, and the least
    # noise; that is the slope of the cubic through 13 attitudes, those of 11 central differences
    time_s = 0.02 * np.arange(-6, 7)
    slope = np.linalg.pinv(np.vander(time_s, 4, increasing=True))[1]
    noise = np.hypot(0.5, 0.02 * np.linalg.norm(slope))
    # chance of 9000 samples: 0.7 %
    assert made["residuals"]["q"]["rms_residual"] == pytest.approx(noise, rel=0.03)
    assert json.loads(cli("list", "monitor.json", "--json")[1])["monitor"] == made


def test_an_existing_file_is_kept_unless_forced_and_that_is_known_at_once(cli, logs, tmp_path, monkeypatch):
    (tmp_path / "monitor.json").write_text("mine")
    monkeypatch.setattr("gtmbench.study.healthy_records._flown", lambda _: pytest.fail("flown"))
    assert "monitor.json exists; give another --out, or --force" in refused(cli("calibrate"))
    assert (tmp_path / "monitor.json").read_text() == "mine"
    assert cli("calibrate", *logs, "--force")[0] == 0
    assert gb.load_monitor("monitor.json").bank.name == "C"


BAD = {
    "no log": (["nowhere.csv"], "nowhere.csv: no such file"),
    "no bank": (["log1.csv", "--detector", "Z"], "no detector is called 'Z'; there are dissertation, auto, B, C"),
    "no json": (["log1.csv", "--out", "m.pkl"], "its name ends in .json"),
    "no folder": (["log1.csv", "--out", "nowhere/m.json"], "doesn't exist; create it first"),
    "a folder": (["log1.csv", "--out", "folder.json"], "folder.json is a folder"),
    "a rate of nothing": (["log1.csv", "--false-alarms-per-hour", "0"], "--false-alarms-per-hour is 0"),
    "no imperfection": (["log1.csv", "--tolerate", "gain=1"], "imperfection 'gain=1' isn't key=number"),
    "flights of logs": (["log1.csv", "--flights", "3"], "--flights is about flights, and with logs none is flown"),
    "duration of logs": (["log1.csv", "--duration", "3"], "--duration is about flights"),
    "a log twice": (
        ["log1.csv", "log2.csv", "log1.csv"],
        "log1.csv holds the same as log1.csv; give every flight once",
    ),
    "other rates": (["log1.csv", "slow.csv"], "slow.csv: it is sampled every 0.05 s, log1.csv every 0.02 s"),
    "a channel less": (["log1.csv", "gyros.csv"], "gyros.csv: bank C needs p, q, r, phi, psi, theta"),
    "what can be used": (["gyros.csv"], "with these channels can be used: bank leave-one-out, bank paper"),
    "too short": (["short.csv"], "15 samples; give at least 20"),
    "too short for whitening": (["brief.csv"], "samples"),
    "not a log": (["junk.csv"], "junk.csv"),
    "no flights": (["--flights", "0"], "flights is 0; it must be a whole number, 1 or more"),
    "no excitation": (["--excitation", "loop"], "no excitation 'loop'"),
    "no seed": (["--seed", "-1"], "seed is -1"),
    "a flight too long": (["--duration", "1e9"], "--duration is 1e+09"),
    "a flight too short": (["--duration", "0.05", "--flights", "1"], "too short"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_leaves_nothing(cli, written, name, tmp_path):
    shutil.copytree(written, tmp_path, dirs_exist_ok=True)
    (tmp_path / "folder.json").mkdir()
    (tmp_path / "junk.csv").write_text("time_s,p\n0,much\n")
    before = names(tmp_path)
    arguments, message = BAD[name]
    assert message in refused(cli("calibrate", *arguments))
    assert names(tmp_path) == before


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_is_not_ours_is_refused_at_once(cli, tmp_path):
    (tmp_path / "theirs").mkdir(mode=0o500)
    assert "Permission denied" in refused(cli("calibrate", "--out", "theirs/m.json"))


@pytest.mark.nightly
@pytest.mark.skipif(os.name != "posix", reason="sends a signal to a group of processes")
def test_ctrl_c_while_processes_fly_ends_with_130_at_once(tmp_path):
    """Whoever started pytest may have told it to ignore Ctrl-C."""
    script = (
        "import os, signal; os.cpu_count = lambda: 2\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from gtmbench.cli import app, monitor\n"
        "from gtmbench.study.healthy_records import CalibrationFlights as Flights\n"
        "whole = Flights.records\n"
        "def records(self, bank, *, processes, progress):\n"
        "    print(flush=True)\n"
        "    return whole(self, bank, processes=processes, progress=progress)\n"
        "Flights.records = records\n"
        "app.main(['calibrate', '--flights', '4', '--duration', '5000'])\n"
    )
    command = [sys.executable, "-c", script]
    flying = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    flying.stdout.readline()
    time.sleep(1.0)  # so that the processes fly
    began = time.monotonic()
    os.killpg(flying.pid, signal.SIGINT)
    _, err = flying.communicate(timeout=60)
    assert flying.returncode == 130
    assert err.strip() == "gtmbench: interrupted; nothing is half-written"
    assert time.monotonic() - began < 5.0
    assert names(tmp_path) == []


def test_every_log_has_imperfections_of_its_own(tmp_path):
    gb.write_log(record(200, seed=1), tmp_path / "a.csv")
    gb.write_log(record(201, seed=1), tmp_path / "b.csv")
    bank = gb.load_bank("paper")
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    read, provenance = logged_records(paths, bank, imperfections=gb.Imperfections(bias=1.0))
    plain, _ = logged_records(paths, bank)
    first, second = (with_bias["p"][:200] - without["p"][:200] for with_bias, without in zip(read, plain, strict=True))
    assert np.ptp(first) < 1e-12
    assert abs(first[0] - second[0]) > 1e-3
    assert (read[0]["beta"] == plain[0]["beta"]).all()
    assert provenance["tolerated_imperfections"] == "bias 1"


@pytest.mark.parametrize("name", shipped_banks())
def test_bank_shows_residuals_signatures_and_blind_spots(cli, name):
    code, out, err = cli("list", name)
    signatures = gb.signatures(gb.load_bank(name))
    assert (code, err) == (0, "")
    assert all(line in out for line in signatures.blind_spots)
    assert all(any(line.split()[:1] == [channel] for line in out.splitlines()) for channel in signatures.channels)
    printed = json.loads(cli("list", name, "--json")[1])
    assert printed["blind_spots"] == list(signatures.blind_spots)
    assert printed["signatures"] == {
        channel: dict(zip(signatures.outputs, pattern, strict=True)) for channel, pattern in signatures.pattern.items()
    }


def test_bank_shows_a_file_of_mine_and_a_monitor(cli, tmp_path):
    (tmp_path / "mine.toml").write_text('[[residuals]]\noutput = "q"\ninputs = ["theta_rate"]\n')
    assert "Of theta only changes enter" in cli("list", "mine.toml")[1]
    gb.save_monitor(monitor("C"), tmp_path / "m.json")
    out = cli("list", "m.json")[1]
    assert "calibrated on: 3 records" in out
    assert "slower drifts than these" in out
    assert cli("list", "m.json", "-q") == (0, "", "")


@pytest.mark.parametrize("text", ["{}", "[", '{"format": "gtmbench monitor", "version": 9}'])
def test_a_broken_monitor_is_one_line(cli, tmp_path, text):
    (tmp_path / "m.json").write_text(text)
    assert refused(cli("list", "m.json")).startswith("gtmbench: m.json: ")


ODD = [
    {"source": "flights", "seeds": 3, "duration_s": "long"},
    {"source": "logs", "logs": ["a"]},
    {"records": None, "threshold_hours": "many", "false_alarms_per_hour": True},
    {"threshold_spread": {"median": "much", "within": None}},
    {"threshold_spread": {"median": 1.0, "within": None}},
    {},
]


@pytest.mark.parametrize("provenance", ODD)
def test_whatever_the_provenance_holds_a_monitor_is_shown(cli, tmp_path, provenance):
    gb.save_monitor(monitor("C"), tmp_path / "m.json")
    document = json.loads((tmp_path / "m.json").read_text())
    (tmp_path / "m.json").write_text(json.dumps(resealed(document | {"provenance": provenance})))
    code, out, err = cli("list", "m.json")
    assert (code, err) == (0, "")
    assert "calibrated on: " in out


OWN = {
    "both ways": (["--detector", "C", "--inputs", "p", "--outputs", "r"], "both --detector and --inputs/--outputs"),
    "no outputs": (["--inputs", "p,beta"], "--outputs is missing"),
    "no inputs": (["--outputs", "r"], "--inputs is missing"),
    "itself": (["--inputs", "r,p", "--outputs", "r"], "'r' is both pseudo input and pseudo output"),
    "nothing named": (["--inputs", ",", "--outputs", "r"], "at least one pseudo input"),
    "look": (["--inputs", "p", "--outputs", "r", "--look", "-1"], "--look is -1"),
    "a part of two logs": (["two.csv", "--healthy", "0:9"], "--healthy is a part of one log, and 2 are given"),
    "a log as a part": (["--healthy", "mine.csv"], "name logs that are healthy as a whole without --healthy"),
    "a part, with imperfections": (["--healthy", "0:9", "--tolerate", "bias=1"], "--tolerate is about whole logs"),
}


@pytest.mark.parametrize(("given", "said"), OWN.values(), ids=OWN)
def test_what_is_learnt_on_a_log_is_refused_before_it_is_read(cli, tmp_path, given, said):
    (tmp_path / "mine.csv").write_text("nothing")
    assert said in refused(cli("calibrate", "mine.csv", *given, "--out", "m.json"))
    assert not (tmp_path / "m.json").exists()


def test_a_part_needs_a_log(cli):
    assert "--healthy is about logs, and none is given" in cli("calibrate", "--healthy", "0:9")[2]
    assert "--rate is about logs, and none is given" in cli("calibrate", "--rate", "25")[2]
