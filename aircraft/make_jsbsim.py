"""Write `jsbsim.toml`: what is known of the aircraft that come with JSBSim, as `aircraft.toml` says it of one.

    python aircraft/make_jsbsim.py [NAME ...]

Every one is surveyed (gtmbench.bench.survey): how it is commanded, what its surfaces do, how large excitations are, and
its trim, at the condition that stands here or at one that its wing loading suggests; then gains are found for its
autopilot (gtmbench.bench.tuning). None of their files is copied.
"""

from __future__ import annotations

import sys
import tomllib
from dataclasses import asdict
from pathlib import Path

from gtmbench.bench.aircraft import Facts, aircraft_of, listed
from gtmbench.bench.known_aircraft import jsbsim_aircraft
from gtmbench.bench.survey import survey
from gtmbench.bench.tuning import find_autopilot
from gtmbench.errors import GtmbenchError

TARGET = Path(__file__).parent / "jsbsim.toml"
HEAD = """\
# What gtmbench knows of the aircraft that come with JSBSim: one table each, with the keys of an aircraft.toml.
# Written by make_jsbsim.py; aircraft that aren't here have no trim that it finds.
"""
TITLES = {
    "737": "Boeing 737, twin-jet airliner",
    "787-8": "Boeing 787-8, twin-jet airliner",
    "A320": "Airbus A320, twin-jet airliner",
    "A4": "Douglas A-4 Skyhawk, attack aircraft",
    "B747": "Boeing 747, four-engined airliner",
    "Boeing314": "Boeing 314 Clipper, flying boat",
    "C130": "Lockheed C-130 Hercules, turboprop transport",
    "Camel": "Sopwith Camel, biplane of 1917",
    "Concorde": "Concorde, supersonic airliner",
    "DHC6": "De Havilland Canada DHC-6 Twin Otter, turboprop",
    "F4N": "McDonnell F-4N Phantom II, fighter",
    "F80C": "Lockheed F-80C Shooting Star, jet of 1948",
    "J3Cub": "Piper J-3 Cub, light aircraft",
    "L17": "Ryan L-17 Navion, light aircraft",
    "MD11": "McDonnell Douglas MD-11, three-engined airliner",
    "OV10": "North American OV-10 Bronco, turboprop",
    "SGS": "SGS, glider",
    "Short_S23": "Short S.23 Empire, flying boat",
    "T37": "Cessna T-37 Tweet, jet trainer",
    "T38": "Northrop T-38 Talon, supersonic trainer",
    "XB-70": "North American XB-70 Valkyrie, supersonic bomber",
    "c172p": "Cessna 172P Skyhawk, light aircraft",
    "c172r": "Cessna 172R Skyhawk, light aircraft",
    "c172x": "Cessna 172 with an autopilot and imperfect actuators",
    "c310": "Cessna 310, light twin",
    "c182": "Cessna 182 Skylane, light aircraft",
    "dr1": "Fokker Dr.I, triplane of 1917",
    "f104": "Lockheed F-104C Starfighter",
    "f15": "McDonnell Douglas F-15 Eagle, fighter",
    "f16": "General Dynamics F-16, fly-by-wire fighter",
    "fokker100": "Fokker 100, twin-jet airliner",
    "global5000": "Bombardier Global 5000, business jet",
    "minisgs": "Mini SGS, a glider of 15 kt",
    "pa28": "Piper PA-28, light aircraft",
    "pc7": "Pilatus PC-7, turboprop trainer",
    "pogo-jsbsim": "Convair Pogo, turboprop",
    "sgs126": "Schweizer SGS 1-26, glider",
    "sgs233": "Schweizer SGS 2-33, glider",
    "t6texan2": "Beechcraft T-6 Texan II, turboprop trainer",
    "wrightFlyer1903": "Wright Flyer of 1903",
}
CONDITIONS = {  # ft, kt; where the one that is suggested is none, or ends in the ground
    "C130": (5_000.0, 100.0),
    "F80C": (10_000.0, 280.0),
    "c172x": (5_000.0, 90.0),
    "f15": (30_000.0, 450.0),
    "f16": (10_000.0, 330.0),
    "pa28": (5_000.0, 90.0),
}
PROPERTIES = {"Boeing314": {f"fcs/advance-cmd-norm{motor}": 0.3 for motor in ("", "[1]", "[2]", "[3]")}}  # or they stop


def main() -> None:
    """Survey those that are named, or all; the others stay as they are."""
    entries = tomllib.loads(TARGET.read_text(encoding="utf-8")) if TARGET.exists() else {}
    for name in sys.argv[1:] or TITLES:
        at, properties = CONDITIONS.get(name), PROPERTIES.get(name)
        facts = survey(jsbsim_aircraft()[name], without_io=True, at=at, properties=properties)
        if "excitation" not in facts:
            entries.pop(name, None)
            print(f"{name}: no trim is found; left out", flush=True)
            continue
        entries[name] = facts | {"title": TITLES[name]} | gains(name, facts)
        print(f"{name}: {facts['trim']['altitude_ft']:g} ft, {facts['trim']['tas_kt']:g} kt", flush=True)
    TARGET.write_text(listed(entries, HEAD), encoding="utf-8")


def gains(name: str, facts: Facts) -> Facts:
    """Return the table of an autopilot that holds an aircraft, or none."""
    try:
        tuned = find_autopilot(aircraft_of(jsbsim_aircraft()[name], facts))
    except GtmbenchError as error:
        print(f"{name}: {error}", flush=True)
        return {}
    off = f"{tuned.altitude_off_ft:.0f} ft and {tuned.tas_off_kt:.0f} kt off, bank {tuned.bank_deg:.0f} deg"
    print(f"{name}: an autopilot, {off}", flush=True)
    return {"autopilot": asdict(tuned.autopilot)}


if __name__ == "__main__":
    main()
