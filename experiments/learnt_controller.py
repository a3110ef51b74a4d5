"""Learn to fly the GTM with a random search, and compare that with the autopilot under a gyro's fault.

A linear policy, from what the sensors read to the commands, is learnt by augmented random search (Mania, Guy and Recht,
2018) in ``gtmbench/GTM-v0``: in four of five episodes some gyro breaks at a random time. Then both fly on air that
neither the policy nor anybody else has seen, healthy and with each fault, on the same seeds.

    python experiments/learnt_controller.py --minutes 4 --out experiments/reports/learnt_controller
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import gtmbench as gb
from gtmbench.gym import ID, GtmEnv
from studies.conduct import write_report

Action = Callable[[GtmEnv, NDArray[np.float32]], NDArray[np.float32]]
HELD_SEEDS = range(900_001, 900_021)  # looked at once, when the training was as it is
ONSET_S, EPISODE_S = 10.0, 40.0
FAULTS: dict[str, gb.Fault | None] = {
    "healthy": None,
    **{f"sign flip of {name}": gb.SignFlip(channel=name, onset_s=ONSET_S) for name in "pqr"},
    **{f"jam of {name}": gb.Jam(channel=name, onset_s=ONSET_S) for name in "pqr"},
    **{f"bias of {name}, 10 deg/s": gb.Bias(channel=name, onset_s=ONSET_S, size=10.0) for name in "pqr"},
}
_DIRECTIONS, _BEST, _STEP, _SPREAD = 8, 4, 0.02, 0.03


def environment(faults: object = ()) -> GtmEnv:
    """Return the environment, whose targets an episode draws."""
    targets = {"altitude_ft": [-50.0, 50.0], "psi_deg": [-15.0, 15.0]}
    made = gymnasium.make(ID, duration_s=EPISODE_S, faults=faults, targets=targets)
    bare = made.unwrapped
    assert isinstance(bare, GtmEnv)
    return bare


def some_fault(random: np.random.Generator) -> tuple[gb.Fault, ...]:
    """Break a gyro in four of five episodes."""
    broken = [fault for fault in FAULTS.values() if fault is not None]
    if random.random() < 0.2:
        return ()
    return (replace(broken[random.integers(len(broken))], onset_s=float(random.uniform(2.0, 20.0))),)


def episode(env: GtmEnv, act: Action, seed: int, **options: Any) -> tuple[float, str]:
    """Return an episode's mean reward over its whole time, and why it ended; what is cut short earns nothing more."""
    seen, _ = env.reset(seed=seed, options=options)
    total, steps = 0.0, round(EPISODE_S * 50)
    while True:
        seen, reward, terminated, truncated, info = env.step(act(env, seen))
        total += reward
        if terminated or truncated:
            return total / steps, info["end"]


def linear(weights: NDArray[np.float64]) -> Action:
    """Return a policy: weights, shape (4, 13), times the observation."""
    return lambda _, seen: (weights @ seen).astype(np.float32)


def autopilot() -> Action:
    """Return the GTM's autopilot as a policy; it flies to the target, at the environment's own rate."""
    flown: list[Any] = []

    def act(env: GtmEnv, _: NDArray[np.float32]) -> NDArray[np.float32]:
        simulation = env.simulation
        if simulation.time_s == 0.0:
            held = replace(
                simulation.trim,
                altitude_ft=env.tracked["altitude"],
                yaw_deg=env.tracked["psi"],
                tas_kt=env.tracked["tas"],
            )
            pilot = simulation.aircraft.autopilot
            assert pilot is not None
            flown[:] = [pilot.engage(held, simulation.aircraft.limits, 0.02)]
        return env.action_of(flown[0](simulation.readings))

    return act


def learnt(seconds: float, seed: int = 1) -> tuple[NDArray[np.float64], int]:
    """Search for so long; return the weights and how many episodes that took."""
    random, env = np.random.default_rng(seed), environment(some_fault)
    weights, episodes, until = np.zeros((4, 13)), 0, time.monotonic() + seconds
    while time.monotonic() < until:
        directions = random.standard_normal((_DIRECTIONS, *weights.shape))
        gains = np.empty((_DIRECTIONS, 2))
        for i, direction in enumerate(directions):
            flight = int(random.integers(800_000))  # the same air and fault for both
            for side, sign in enumerate((1.0, -1.0)):
                gains[i, side], _ = episode(env, linear(weights + sign * _SPREAD * direction), flight)
        best = np.argsort(-gains.max(axis=1))[:_BEST]
        slope = np.tensordot(gains[best, 0] - gains[best, 1], directions[best], axes=1)
        weights = weights + _STEP / (_BEST * max(float(gains[best].std()), 1e-6)) * slope
        episodes += 2 * _DIRECTIONS
    return weights, episodes


def compared(weights: NDArray[np.float64]) -> list[tuple[str, list[float], list[int]]]:
    """Return by fault the mean rewards of nobody, the autopilot and the policy, and how many flights were lost."""
    env, rows = environment(), []
    pilots = {"nobody": linear(np.zeros((4, 13))), "autopilot": autopilot(), "learnt": linear(weights)}
    for name, fault in FAULTS.items():
        rewards, lost = [], []
        for act in pilots.values():
            flown = [episode(env, act, seed, faults=[fault] if fault else []) for seed in HELD_SEEDS]
            rewards.append(float(np.mean([reward for reward, _ in flown])))
            lost.append(sum(end != "duration" for _, end in flown))
        rows.append((name, rewards, lost))
    return rows


def report(weights: NDArray[np.float64], episodes: int, minutes: float) -> str:
    """Return the comparison as a page."""
    lines = [
        "# A learnt controller beside the autopilot",
        "",
        f"A linear policy of 52 weights, learnt in {minutes:g} minutes on one core ({episodes:,} episodes of "
        f"{EPISODE_S:g} s), and the GTM's autopilot in `{ID}`: turbulence, targets within 50 ft and 15 deg of trim. "
        f"Mean reward a step (at most 1) and flights lost of {len(HELD_SEEDS)}, on seeds that nobody trained or tuned "
        f"on; faults begin at {ONSET_S:g} s.",
        "",
        "| fault | trim held | autopilot | learnt | lost: trim held, autopilot, learnt |",
        "|---|---|---|---|---|",
    ]
    for name, rewards, lost in compared(weights):
        lines.append(f"| {name} | {' | '.join(f'{r:.2f}' for r in rewards)} | {', '.join(map(str, lost))} |")
    note = (
        "`python experiments/learnt_controller.py` makes this page. How many episodes fit into the time depends on the "
        "machine, so another run learns another policy."
    )
    return "\n".join([*lines, "", note, ""])


def main() -> None:
    """Learn, compare and write."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--minutes", type=float, default=4.0, help="how long to learn")
    asked.add_argument("--out", type=Path, default=Path("out/learnt_controller"), help="folder of the report")
    told = asked.parse_args()
    weights, episodes = learnt(60.0 * told.minutes)
    told.out.mkdir(parents=True, exist_ok=True)
    text = report(weights, episodes, told.minutes)
    write_report(told.out, text, told)
    print(text)


if __name__ == "__main__":
    main()
