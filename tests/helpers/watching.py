"""Studies, and a monitor that watches, made once a process: calibrating and flying take seconds."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

import numpy as np

import gtmbench as gb
from gtmbench.detectors.protocol import Score
from gtmbench.method.residual import came_down, rising
from tests.helpers.monitors import shared

EXAMPLE = Path(__file__).parents[2] / "docs/how_to/examples/limit_check.py"
SHIPPED = ("drift", "deadzone", "saturation", "rate_saturation", "jam")
EXCITATION = "multisine+turbulence"
MIXED = """
duration_s = 120.0
excitation = "multisine+turbulence"
noise = "t2"
severity_reference_s = [25.0, 60.0]
[operator]
identify_s = [5.0, 50.0]
[alarm]
threshold_s = [50.0, 100.0]
watch_from_s = 5.0
healthy_records = 2
[[faults]]
kind = "drift"
channels = ["p"]
onset_s = 60.0
slope = [0.3, 1e-5]
[[faults]]
kind = "saturation"
channels = ["q"]
onset_s = 50.0
duration_s = 30.0
limit = "20 % of peak"
[[faults]]
kind = "jam"
channels = ["r", "altitude"]
onset_s = 60.0
[[faults]]
kind = "saturation"
channels = ["r"]
onset_s = 60.0
limit = 500.0
"""


@cache
def monitor():
    """Bank C, calibrated on six flights of two minutes."""

    def make():
        flights = [gb.fly(excitation=EXCITATION, duration_s=120, seed=900 + i) for i in range(6)]
        return gb.calibrate(
            [gb.measure(flight, noise="t2", seed=900 + i) for i, flight in enumerate(flights)], bank=gb.load_bank("C")
        )

    return shared("gtm-C", make)


@cache
def sensed():
    """140 s of the GTM as a log has them, with accelerometers."""
    truth = gb.fly(excitation="multisine+turbulence", duration_s=140, seed=77)
    return gb.measure(truth, noise="t2", seed=77).select(("p", "q", "r", "phi", "theta", "psi", "nx", "ny", "nz"))


@cache
def cautious(bank="C"):
    """A monitor that stands on their first minute."""
    return gb.calibrate([sensed().between(0.0, 60.0)], bank=gb.load_bank(bank), estimator=gb.Bayesian())


@cache
def scenario(name="mixed", text=MIXED):
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.toml"
        path.write_text(text)
        return gb.load_scenario(path)


@cache
def dissertation(seed=1):
    """The main job: fifteen trials, watched by the dissertation's operator."""
    return gb.run_study([gb.load_scenario(name) for name in SHIPPED], seed=seed)


@cache
def drift():
    """Its first three trials."""
    return replace(dissertation(), trials=dissertation().trials[:3])


@cache
def study():
    """Six trials: a drift, one too slow, a saturation that ends, a jam, one that nobody watches, one without effect."""
    return gb.run_study([scenario()], detectors=[monitor()])


def spike(record):
    """Return when q is far from the sample before: a detector of no scores."""
    return record.time_s[1:][np.abs(np.diff(record["q"])) > 20.0]


class Swing:
    """A detector of one's own: how far yaw is from its mean of the last second, in deg/s; calibrated it is itself."""

    name = "swing"
    channels = ("r",)
    suspects = ()
    sample_period_s = None
    look_ahead_s = 0.0
    memory_s = 1.0
    provenance: ClassVar = {"limit": np.float64(100.0), "unknown": float("nan")}

    def watch(self, record):
        """Return the swing, and alarms where it is above 100 deg/s."""
        mean = np.convolve(record["r"], np.ones(100) / 100.0)[: len(record)]
        values = np.abs(record["r"] - mean)
        armed = came_down(values, 100.0)
        score = Score(
            name="swing",
            values=values,
            known_s=record.time_s,
            threshold=100.0,
            unit="deg/s",
            channels=("r",),
            armed=armed,
        )
        times = record.time_s[rising(values, 100.0)].tolist()
        alarms = [gb.Alarm(number=i, time_s=at, onset_s=at, source="swing") for i, at in enumerate(times)]
        return gb.Watch(monitor=self, record=record, scores={"swing": score}, alarms=tuple(alarms))

    def stream(self):
        """Return none: nothing here needs one."""
        raise NotImplementedError


@cache
def several():
    """The same trials, watched by all kinds of detectors: the scenario's own, a bank, a function, one of one's own."""
    return gb.run_study([scenario()], detectors=["dissertation", monitor(), gb.FunctionDetector(spike), Swing()])


def written_once(write, folder):
    """Return a function that writes the recording of what a function makes, once, and gives its path."""

    @cache
    def path_of(making):
        path = folder / f"{making.__module__}.{making.__name__}.rrd"  # two files' functions may have one name
        write(making(), path)
        return path

    return path_of
