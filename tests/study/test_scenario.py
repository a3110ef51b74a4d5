"""Scenarios: what is shipped loads, what a list means, and what can't be meant is refused by file and key."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import gtmbench
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault, other_channel, severity
from gtmbench.faults.parameter import Parameter
from gtmbench.faults.registry import FAULTS
from gtmbench.files.shipped import shipped_scenarios
from gtmbench.study.fault_tables import Severity, build, parse_severity, resolve
from gtmbench.study.scenario import AlarmSetup, OperatorSetup, Setup, load_scenario
from gtmbench.values.channels import CHANNELS, SENSORS
from gtmbench.values.record import Record

TEMPLATE = Path(gtmbench.__file__).parent / "cli" / "template.toml"


def fault(kind="drift", channels=("p",), onset=300.0, more="slope = 0.05"):
    return f'[[faults]]\nkind = "{kind}"\nchannels = {list(channels)}\nonset_s = {onset}\n{more}\n'


DRIFT = fault()


@pytest.fixture
def load(tmp_path):
    def write_and_load(content):
        path = tmp_path / "mine.toml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return load_scenario(path)

    return write_and_load


@pytest.fixture
def refused(load, tmp_path):
    """Return a function that loads what must be refused, checks that the file is named and returns the message."""

    def message(content):
        with pytest.raises(InputError) as raised:
            load(content)
        assert str(raised.value).startswith(str(tmp_path / "mine.toml"))
        return str(raised.value)

    return message


def test_a_shipped_scenario_flies_in_the_loop():
    scenario = load_scenario("in_the_loop")
    assert scenario.setup.autopilot == load_aircraft("gtm").chain_autopilot
    assert {spec.channel for spec in scenario.faults} == {"p", "q", "r"}


@pytest.mark.parametrize("name", sorted(set(shipped_scenarios()) & set(FAULTS)))
def test_a_shipped_scenario_tries_one_fault_on_every_gyro_in_the_dissertations_setup(name):
    scenario = load_scenario(name)
    assert [(spec.kind, spec.channel) for spec in scenario.faults] == [(name, "p"), (name, "q"), (name, "r")]
    assert {(spec.onset_s, spec.duration_s) for spec in scenario.faults} == {(300.0, None)}
    assert scenario.setup == Setup(snr=50.0)
    assert scenario == load_scenario(shipped_scenarios()[name]) == load_scenario(Path("faults") / f"{name}.toml")


def test_the_setup_is_the_one_of_section_4_4():
    """Ts 0.01 s over 500 s, SNR 50, r = d = 50, [p q beta] -> r, w = 1000: what no key states."""
    setup = Setup()
    assert setup.operator == OperatorSetup(
        inputs=("p", "q", "beta"), outputs=("r",), causal_order=50, noncausal_order=50, identify_s=(25.0, 200.0)
    )
    assert (setup.aircraft, setup.excitation, setup.duration_s) == ("gtm", "dissertation", 500.0)
    assert (setup.alarm.window, setup.alarm.threshold_factor) == (1000, 1.5)


def test_the_template_states_the_defaults():
    scenario = load_scenario(TEMPLATE)
    assert scenario.setup == Setup(snr=50.0)
    assert (scenario.setup.operator, scenario.setup.alarm) == (OperatorSetup(), AlarmSetup())
    slopes = [(spec.channel, spec.severities["slope"].value) for spec in scenario.faults if spec.kind == "drift"]
    assert slopes == [(channel, slope) for channel in "pqr" for slope in (0.05, 0.1)]


def test_what_the_template_leaves_out_loads_too(load):
    lines = TEMPLATE.read_text(encoding="utf-8").split("# ---- the faults")[1].splitlines()[1:]
    commented_in = "\n".join(line.removeprefix("# ") for line in lines)
    assert {spec.kind for spec in load(commented_in).faults} <= set(FAULTS)


def test_the_template_names_every_kind():
    assert set(FAULTS) <= set(re.findall(r"\w+", TEMPLATE.read_text(encoding="utf-8")))


def test_severities_and_channels_multiply_into_trials(load):
    scenario = load(fault(channels=["p", "r"], more="slope = [0.05, 0.1, '20 % of slew']") + fault(channels=["q"]))
    assert [
        (spec.channel, (spec.severities["slope"].value, spec.severities["slope"].of)) for spec in scenario.faults
    ] == [
        ("p", (0.05, None)),
        ("p", (0.1, None)),
        ("p", (0.2, "slew")),
        ("r", (0.05, None)),
        ("r", (0.1, None)),
        ("r", (0.2, "slew")),
        ("q", (0.05, None)),
    ]


def test_every_key_that_is_stated_arrives(load):
    scenario = load(
        'title = "T"\nexcitation = "multisine"\nduration_s = 100\nseed = 7\nnoise = "t2"\n'
        "severity_reference_s = [1, 99]\n"
        '[operator]\ninputs = ["p"]\noutputs = ["q", "r"]\ncausal_order = 3\nnoncausal_order = 0\n'
        "identify_s = [5, 50]\n"
        "[alarm]\nwindow = 10\nthreshold_factor = 2\nthreshold_s = [50, 90]\nwatch_from_s = 6\nhealthy_records = 1\n"
        + fault(onset=70, more="slope = 1\nduration_s = 5")
    )
    assert (scenario.name, scenario.title) == ("mine", "T")
    assert scenario.setup == Setup(
        excitation="multisine",
        duration_s=100.0,
        seed=7,
        snr=None,
        noise="t2",
        severity_reference_s=(1.0, 99.0),
        operator=OperatorSetup(
            inputs=("p",), outputs=("q", "r"), causal_order=3, noncausal_order=0, identify_s=(5.0, 50.0)
        ),
        alarm=AlarmSetup(
            window=10, threshold_factor=2.0, threshold_s=(50.0, 90.0), watch_from_s=6.0, healthy_records=1
        ),
    )
    assert (scenario.faults[0].onset_s, scenario.faults[0].duration_s) == (70.0, 5.0)


@pytest.mark.parametrize("channel", SENSORS)
def test_the_channels_own_unit_may_be_stated_and_no_other(load, refused, channel):
    unit = CHANNELS[channel].unit
    assert load(fault(channels=[channel], more=f'slope = 1\nunit = "{unit}"')).faults[0].channel == channel
    message = refused(fault(channels=[channel], more='slope = 1\nunit = "rad/s"'))
    assert f"channel '{channel}' is in {unit}" in message


WRONG = {  # what is written, and what the message has to name
    "key": ("duraton_s = 5\n" + DRIFT, ["'duraton_s'", "duration_s", "excitation"]),
    "operator key": (DRIFT + "[operator]\norder = 5", ["'order'", "[operator]", "causal_order"]),
    "alarm key": (DRIFT + "[alarm]\nwidth = 5", ["'width'", "[alarm]", "window"]),
    "table": (DRIFT + "[monitor]\nwindow = 5", ["'monitor'", "operator", "alarm"]),
    "no table": ("operator = 5\n" + DRIFT, ["operator", "5", "table"]),
    "fault key": (fault(more="slope = 1\nwidth = 2"), ["'width'", "slope", "onset_s"]),
    "fault kind": (fault(kind="freeze"), ["'freeze'", *FAULTS]),
    "kind of a list": (DRIFT.replace('"drift"', '["drift"]'), ["drift", *FAULTS]),
    "no kind": (DRIFT.replace('kind = "drift"', ""), ["kind", *FAULTS]),
    "unit of another channel": (fault(channels=["p", "beta"], more='slope = 1\nunit = "deg/s"'), ["'beta' is in deg"]),
    "no slope": (fault(more=""), ["'slope'", "missing"]),
    "no onset": (DRIFT.replace("onset_s = 300.0", ""), ["'onset_s'", "missing"]),
    "no channels": (fault(channels=[]), ["channels", "list of channel names"]),
    "channel": (fault(channels=["w"]), ["'w'", *SENSORS]),
    "operator channel": (DRIFT + '[operator]\ninputs = ["w"]', ["'w'", *SENSORS]),
    "no operator channel": (DRIFT + "[operator]\ninputs = []", ["operator.inputs", "list of channel names"]),
    "no faults": ("seed = 2", ["[[faults]]"]),
    "no severity": (fault(more="slope = []"), ["slope"]),
    "snr and noise": ('snr = 50\nnoise = "t2"\n' + DRIFT, ["both snr and noise"]),
    "text for a number": ('duration_s = "500"\n' + DRIFT, ["duration_s", "'500'", "number"]),
    "truth for a number": ("seed = true\n" + DRIFT, ["seed", "True", "whole number"]),
    "half a seed": ("seed = 1.5\n" + DRIFT, ["seed", "1.5", "whole number"]),
    "negative seed": ("seed = -1\n" + DRIFT, ["seed", "-1"]),
    "nan": ("duration_s = nan\n" + DRIFT, ["duration_s", "nan"]),
    "negative window": (DRIFT + "[alarm]\nwindow = -1", ["alarm.window", "-1"]),
    "one end": ("severity_reference_s = [25.0]\n" + DRIFT, ["severity_reference_s", "[start, end]"]),
    "no healthy record": (DRIFT + "[alarm]\nhealthy_records = 0", ["alarm.healthy_records"]),
    "onset after the end": (fault(onset=500.1), ["onset_s", "500.1", "500"]),
    "onset before the start": (fault(onset=-1.0), ["onset_s", "-1.0"]),
    "identify after the end": (DRIFT + "[operator]\nidentify_s = [25, 501]", ["operator.identify_s", "500"]),
    "threshold after the end": (DRIFT + "[alarm]\nthreshold_s = [200, 501]", ["alarm.threshold_s", "500"]),
    "reference backwards": ("severity_reference_s = [9, 5]\n" + DRIFT, ["severity_reference_s", "start before"]),
    "short flight": ("duration_s = 100\n" + DRIFT, ["operator.identify_s", "unless it is given", "100"]),
    "share of the wrong thing": (fault(more='slope = "20 % of rms"'), ["slope", "20 % of slew"]),
    "slew of a width": (fault("deadzone", more='half_width = "5 % of slew"'), ["half_width", "rms", "peak"]),
    "endless severity": (fault(more="slope = inf"), ["slope", "inf"]),
    "huge severity": (fault(more=f"slope = 1{'0' * 400}"), ["slope"]),
    "huge time": (f"severity_reference_s = [0, 1{'0' * 400}]\n" + DRIFT, ["severity_reference_s"]),
    "units that differ": (DRIFT + '[operator]\ninputs = ["p"]\noutputs = ["r", "beta"]', ["r in deg/s, beta in deg;"]),
    "expectation": (DRIFT + "[faults.expect.C]\ndetect_in = 3", ["faults, table 1: expect.C", "'detect_in'"]),
    # nobody should fly 500 s to be told of a typing error
    "negative width": (fault("deadzone", more="half_width = -0.5"), ["half_width", "-0.5"]),
    "negative limit": (fault("saturation", more="limit = [1.0, -1.0]"), ["limit", "-1"]),
    "no duration": (fault(more="slope = 1\nduration_s = 0.0"), ["duration_s"]),
    "noise": ('noise = "t3"\n' + DRIFT, ["noise", "t3", "t2"]),
    "snr of 0": ("snr = 0\n" + DRIFT, ["snr"]),
    "excitation": ('excitation = "chirp"\n' + DRIFT, ["excitation", "chirp", "multisine"]),
    "aircraft": ('aircraft = "b747"\n' + DRIFT, ["b747", "gtm"]),
    "factor of 0": (DRIFT + "[alarm]\nthreshold_factor = 0", ["threshold_factor"]),
    "watched after the end": (DRIFT + "[alarm]\nwatch_from_s = 501", ["watch_from_s", "500"]),
    "input and output": (DRIFT + '[operator]\ninputs = ["p", "r"]', ["'r'"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cant_be_meant_is_refused_by_key_with_what_is_legal(refused, case):
    content, named = WRONG[case]
    message = refused(content)
    assert [name for name in named if name not in message] == []


NO_TOML = {
    "no value": b"duration_s =\n",
    "key twice": b"seed = 1\nseed = 2\n",
    "open text": b'title = "half',
    "binary": bytes(range(256)),
    "latin": "title = 'Höhe'".encode("latin-1"),
    "zeros": b"\x00" * 50,
    "deep": b"a = " + b"[" * 100_000,
    "deep tables": b"a = " + b"{b = " * 100_000,
    "endless number": b"seed = 1" + b"0" * 5000,
    "no day": b"seed = 2021-02-30",
    "large": b"# " + b"x" * 1_000_000,
}


@pytest.mark.parametrize("case", NO_TOML)
def test_a_file_that_is_no_toml_is_refused_by_name(refused, case):
    refused(NO_TOML[case])


@pytest.mark.parametrize("source", ["no_such_scenario", "no/such/file.toml", "/", "faults"])
def test_a_missing_scenario_is_refused_with_the_shipped_ones(source):
    with pytest.raises(InputError, match="no scenario") as raised:
        load_scenario(source)
    assert all(name in str(raised.value) for name in shipped_scenarios())


def test_shares_are_of_the_channel_with_its_mean_removed():
    """Worked out by hand: 7 9 7 3 4 less its mean 6 is 1 3 1 -3 -2; the steepest step is -4 in 0.5 s."""
    flight = Record([[7, 1], [9, 1], [7, 1], [3, 1], [4, 9]], channels=["p", "q"], sample_period_s=0.5)
    assert resolve(Severity(value=0.5, of="rms"), flight, "p") == pytest.approx(0.5 * np.sqrt(24 / 5))
    assert resolve(Severity(value=0.4, of="peak"), flight, "p") == pytest.approx(0.4 * 3.0)
    assert resolve(Severity(value=0.2, of="slew"), flight, "p") == pytest.approx(0.2 * 8.0)
    assert resolve(Severity(value=0.05), flight, "p") == 0.05


@pytest.mark.parametrize("text", ["50 % of rms", "50% of rms", " 50 %  of rms ", "50.0 % of rms"])
def test_a_share_reads_the_same_however_it_is_spaced(text):
    share = parse_severity(text, Parameter(name="limit", is_severity=True, default=0.0), key="limit")
    assert share == Severity(value=0.5, of="rms")


@dataclass(frozen=True, kw_only=True)
class Crosstalk(Fault):
    """A toy that reads another channel beside its own."""

    kind: ClassVar[str] = "crosstalk"
    source: str = other_channel()
    share: float = severity(per_second=False)


def test_a_kind_that_reads_another_channel_can_be_written_down(load, refused, monkeypatch):
    monkeypatch.setitem(FAULTS, "crosstalk", Crosstalk)
    written = fault(kind="crosstalk", channels=["p", "q"], more='source = "r"\nshare = 0.2')
    specs = load(written).faults
    assert [(spec.fault.reads, spec.severities["share"].value) for spec in specs] == [
        (("p", "r"), 0.2),
        (("q", "r"), 0.2),
    ]
    assert build(specs[0], {"share": 0.2}).reads == ("p", "r")
    assert "source" in refused(written.replace('source = "r"\n', ""))
    assert "'x'; there are p, q, r" in refused(written.replace('"r"', '"x"'))
