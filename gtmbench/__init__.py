"""gtmbench: fly an aircraft, break a sensor, and find out from the sensors alone.

>>> import gtmbench as gb
>>> flight = gb.fly(duration_s=5.0)
>>> record = gb.measure(flight, snr=50, seed=1)
>>> broken = gb.inject(record, gb.Jam(channel="p", onset_s=3.0))
>>> bool((broken["p"][300:] == broken["p"][299]).all())
True
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# Name by name, so that `import gtmbench` loads nothing but what is used: JSBSim, pandas and SciPy take a second.
_HOMES = {
    "gtmbench.bench.faults": ["Deadzone", "Drift", "Fault", "Jam", "RateSaturation", "Saturation", "inject"],
    "gtmbench.bench.flight": ["fly"],
    "gtmbench.bench.modes": ["Mode", "modes"],
    "gtmbench.bench.sensors": ["measure"],
    "gtmbench.bench.trim": ["Trim", "trim"],
    "gtmbench.channels": ["CHANNELS", "Channel"],
    "gtmbench.errors": ["EnvelopeError", "GtmbenchError", "InputError", "RankWarning", "TrimError"],
    "gtmbench.logs": ["read_log", "write_log"],
    "gtmbench.method.alarms": ["Alarms", "alarms", "threshold"],
    "gtmbench.method.residual": ["Residual", "WindowedNorm", "residual", "windowed_norm"],
    "gtmbench.method.transmissibility": ["Transmissibility", "identify"],
    "gtmbench.record": ["Record"],
    "gtmbench.study.run": ["Study", "Trial", "run", "run_study"],
    "gtmbench.study.scenario": ["Scenario", "load_scenario"],
    "gtmbench.study.score": ["Verdict", "score"],
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = sorted([*_HOME_OF, "__version__"])  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'gtmbench' has no attribute '{name}'")
    value = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
