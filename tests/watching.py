"""A monitor and a study watched by it, made once a process: calibrating and flying take seconds."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import gtmbench as gb

EXAMPLE = Path(__file__).parents[1] / "docs/examples/limit_check.py"
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
    flights = [gb.fly(excitation=EXCITATION, duration_s=120, seed=900 + i) for i in range(6)]
    return gb.calibrate(
        [gb.measure(flight, noise="t2", seed=900 + i) for i, flight in enumerate(flights)], bank=gb.load_bank("C")
    )


@cache
def scenario(name="mixed", text=MIXED):
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.toml"
        path.write_text(text)
        return gb.load_scenario(path)


@cache
def study():
    """Six trials: a drift, one too slow, a saturation that ends, a jam, one that nobody watches, one without effect."""
    return gb.run_study([scenario()], detectors=[monitor()])
