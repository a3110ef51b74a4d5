"""Aircraft: where they stand, what is known of them, and a JSBSim engine with one loaded."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import jsbsim

from gtmbench.errors import GtmbenchError, InputError
from gtmbench.files import share, shipped_aircraft

Span = tuple[float, float]
_ADAMS_BASHFORTH_2 = 3


@dataclass(frozen=True, kw_only=True)
class Aircraft:
    """One aircraft: its folder (with ``NAME/NAME.xml`` and ``NAME/aircraft.toml``) and the facts of the latter.

    ``limits`` bound the commands and ``envelope`` the flight, by channel, in the channel's unit.
    """

    name: str
    title: str
    folder: Path
    altitude_ft: float
    tas_kt: float
    psi_deg: float
    latitude_deg: float
    guess: dict[str, float]
    limits: dict[str, Span]
    envelope: dict[str, Span]


def load_aircraft(name: str) -> Aircraft:
    """Return an aircraft by name (one of the package's) or by the path of its folder.

    Raises
    ------
    InputError
        Where there is no such aircraft or its ``aircraft.toml`` is incomplete.
    """
    folder = Path(name) if "/" in name else share() / "aircraft" / name
    path = folder / "aircraft.toml"
    if not path.is_file():
        raise InputError(f"no aircraft '{name}'; there are {', '.join(shipped_aircraft())}, or give a folder's path")
    try:
        facts = tomllib.loads(path.read_text())
        trim = facts["trim"]
        return Aircraft(
            name=folder.name,
            title=facts["title"],
            folder=folder.resolve(),
            altitude_ft=float(trim["altitude_ft"]),
            tas_kt=float(trim["tas_kt"]),
            psi_deg=float(trim["psi_deg"]),
            latitude_deg=float(trim["latitude_deg"]),
            guess={key: float(value) for key, value in trim["guess"].items()},
            limits={key: _span(value) for key, value in facts["limits"].items()},
            envelope={key: _span(value) for key, value in facts["envelope"].items()},
        )
    except (tomllib.TOMLDecodeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} is incomplete or malformed: {error!r}; see the GTM's for every key") from error


def _span(value: list[float]) -> Span:
    low, high = value
    return float(low), float(high)


@contextmanager
def quiet() -> Iterator[list[str]]:
    """Keep JSBSim off the terminal; its errors are collected in the list given.

    JSBSim's logger belongs to the thread and must not outlive the interpreter, so the former one is put back.
    """
    errors: list[str] = []
    former = jsbsim.get_logger()
    jsbsim.set_logger(_Collector(errors))
    try:
        yield errors
    finally:
        jsbsim.set_logger(former)


class _Collector(jsbsim.FGLogger):
    def __init__(self, errors: list[str]) -> None:
        super().__init__()
        self.errors = errors
        self.level = jsbsim.LogLevel.BULK

    def set_level(self, level: jsbsim.LogLevel) -> None:
        self.level = level

    def file_location(self, filename: str, line: int) -> None:
        pass

    def message(self, message: str) -> None:
        # loading a model ties two properties a second time; JSBSim calls that an error and goes on
        if self.level >= jsbsim.LogLevel.ERROR and message.strip() and "Failed to tie" not in message:
            self.errors.append(message.strip())

    def format(self, format: jsbsim.LogFormat) -> None:  # noqa: A002
        pass

    def flush(self) -> None:
        pass


def engine(aircraft: Aircraft, sample_period_s: float) -> jsbsim.FGFDMExec:
    """Return a fresh JSBSim instance with the aircraft loaded; call it inside `quiet`.

    Fresh, because an instance that has flown before gives another flight for the same turbulence seed.
    """
    with quiet() as errors:
        fdm = jsbsim.FGFDMExec(str(aircraft.folder.parent.parent))
        fdm.set_output_path(str(aircraft.folder))
        fdm.set_aircraft_path(str(aircraft.folder.parent))
        for integrator in ("rate", "position"):
            # JSBSim integrates rotation by rectangles unless told: that is 2 to 3 % of the GTM's yaw rate at 100 Hz
            fdm[f"simulation/integrator/{integrator}/rotational"] = _ADAMS_BASHFORTH_2
        fdm.set_dt(sample_period_s)  # components take it over when they load: before load_model
        loaded = fdm.load_model(aircraft.name)
        fdm.disable_output()
    if not loaded:
        raise GtmbenchError(f"JSBSim can't load {aircraft.folder / aircraft.name}.xml: {'; '.join(errors)}")
    return fdm
