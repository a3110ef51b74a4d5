"""A kind of a user's own on the command line: injected, told by alarms, of one log and of several; or refused."""

import json

import pytest

import gtmbench as gb
from gtmbench.faults import registry
from tests.helpers.hostile import refused

FADING = '''
from dataclasses import dataclass
import numpy as np
import gtmbench as gb


@gb.register_fault
@dataclass(frozen=True, kw_only=True)
class Fading(gb.Fault):
    """The signal dies away with a time constant."""

    kind = "fading"
    shape = gb.Shape(how="search", parameter="fading_s", low=0.5, high=60)
    fading_s: float = gb.severity(unit="s", low=0.0, above=True)

    def distort(self, readings, elapsed_s, sample_period_s, carried):
        return readings[:, 0] * np.exp(-elapsed_s / self.fading_s), carried
'''


@pytest.fixture
def own(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "_registered", {})
    path = tmp_path / "fading.py"
    path.write_text(FADING)
    return path


@pytest.mark.nightly
def test_it_is_injected_and_told_by_an_alarm(cli, own, tmp_path):
    healthy = gb.measure(gb.fly("gtm", "multisine+turbulence", 240.0, seed=1), noise="t2", seed=1)
    gb.write_log(healthy, tmp_path / "flight.csv")
    (tmp_path / "logs").mkdir()
    fault = ("--fault", "fading:r:fading_s=8", "--onset", "160", "--attitude", "own")
    code, _, err = cli("inject", "flight.csv", *fault, "--import", own, "--out", "logs/broken.csv")
    assert (code, err) == (0, "")
    code, out, _ = cli("monitor", "logs/broken.csv", "--import", own)
    assert code == 1
    assert out.startswith("One of the yaw gyro (r) and heading (psi) failed from 16")
    _, out, _ = cli("monitor", "logs/broken.csv", "--import", own, "--json")
    kinds = [each["kind"] for finding in json.loads(out)["findings"] for each in finding["judgements"]]
    assert "fading" in kinds
    code, _, err = cli("monitor", "logs/broken.csv", "--import", own, "--report", "broken.html")
    assert (code, "Traceback" in err) == (1, False)
    assert "gtmbench monitor broken.csv --import fading.py" in (tmp_path / "broken.html").read_text()
    code, out, _ = cli("monitor", "logs", "--out", "fleet", "--import", own)
    assert code == 1  # each log has a process of its own, which imports the file, too


@pytest.mark.parametrize(
    ("was", "now", "said"),
    [
        ('kind = "fading"', 'kind = "drift"', "kind 'drift' of"),
        ("np.exp(-elapsed_s / self.fading_s)", "np.nan", "reads no number of a healthy signal"),
        ("high=60)", "high=60, price=-2)", "price is -2; it must be a finite number, 0 or more"),
    ],
)
def test_a_class_that_cant_be_is_refused_in_a_line(cli, own, was, now, said):
    own.write_text(FADING.replace(was, now))
    assert said in refused(cli("monitor", "flight.csv", "--import", own))
