"""JSBSim's own trim, for models of which the search finds no equilibrium."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

import jsbsim
import numpy as np

from gtmbench.bench.aircraft import Aircraft, aircraft_of, facts_of
from gtmbench.bench.engine import engine, set_condition, silenced, simulating
from gtmbench.errors import GtmbenchError
from gtmbench.values.channels import SURFACES

_LONGEST_S = 10.0
_FULL = 1  # its mode: all six axes
_NORMALISED = "-cmd-norm"
_TABS = ("pitch", "roll", "yaw")  # what it moves in place of elevator, aileron and rudder, where it pleases


def trimmed_by_jsbsim(aircraft: Aircraft, wanted: dict[str, float]) -> tuple[jsbsim.FGFDMExec, dict[str, float]] | None:
    """Return an engine that JSBSim has trimmed, and the condition it stands in; None where it couldn't.

    It moves normalised commands and none of another kind. It can't be interrupted, so another process goes before,
    which can.

    `wanted`: the condition from which it begins, as for `set_condition`.
    """
    if aircraft.motorless or not all(command.property.endswith(_NORMALISED) for command in aircraft.commands.values()):
        return None
    task = json.dumps([str(aircraft.folder), facts_of(aircraft), wanted])
    tried = _is_rehearsed(task, aircraft.model.stat().st_mtime_ns, _LONGEST_S)
    return _trimmed(aircraft, wanted) if tried else None


@lru_cache(maxsize=32)
def _is_rehearsed(task: str, _modified_ns: int, longest_s: float) -> bool:
    """Try a trim in another process, once as long as the model stays the same."""
    rehearsal = [sys.executable, "-c", f"from {__name__} import rehearse; rehearse()"]
    beside = Path(__file__).parents[2]  # Python looks for modules where it runs: there, not among a user's files
    try:
        done = subprocess.run(
            rehearsal, input=task, text=True, capture_output=True, timeout=longest_s, check=False, cwd=beside
        )
    except (subprocess.TimeoutExpired, OSError):
        return False
    return done.returncode == 0


def rehearse() -> None:
    """Trim what stdin tells of; end with code 0 where that can be done."""
    folder, facts, wanted = json.load(sys.stdin)
    sys.exit(_trimmed(aircraft_of(Path(folder), facts), wanted) is None)


def _trimmed(aircraft: Aircraft, wanted: dict[str, float]) -> tuple[jsbsim.FGFDMExec, dict[str, float]] | None:
    fdm = engine(aircraft)
    try:
        with simulating(fdm, aircraft), silenced():
            set_condition(fdm, aircraft, wanted)
            fdm.do_trim(_FULL)
            # a command and its tab add up; nothing may be initialised again: JSBSim forgets its trim then
            for tab, name in zip(_TABS, SURFACES, strict=True):
                fdm[aircraft.commands[name].property] += fdm[f"fcs/{tab}-trim{_NORMALISED}"]
                fdm[f"fcs/{tab}-trim{_NORMALISED}"] = 0.0
    except GtmbenchError:
        return None
    angles = {name: float(np.rad2deg(fdm[f"attitude/{name}-rad"])) for name in ("phi", "theta")}
    commands = {name: fdm[command.property] * command.unit for name, command in aircraft.commands.items()}
    return fdm, {**wanted, **angles, "alpha": float(np.rad2deg(fdm["aero/alpha-rad"])), **commands}
