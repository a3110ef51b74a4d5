"""How a live watch does: latency, CPU, lines a second, bad and slow links, a long flight.

``OPENBLAS_NUM_THREADS=1 python -m tests.live_targets``. Senders are processes of their own, over loopback. It prints a
line of JSON for every part; ``--only`` names parts.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import resource
import socket
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.interpolate import CubicSpline

import gtmbench as gb
from gtmbench.link.packets import in_tlog
from gtmbench.link.source import InputSource, UdpSource
from tests.helpers import links

MONITOR = Path(gb.__file__).with_name("baselines") / "bank-C.json"
CHANNELS = ("p", "q", "r", "phi", "theta", "psi")
FAULTS = (
    lambda channel, at: gb.Bias(channel=channel, onset_s=at, size=3.0),
    lambda channel, at: gb.Drift(channel=channel, onset_s=at, slope=0.5),
    lambda channel, at: gb.Jam(channel=channel, onset_s=at),
    lambda channel, at: gb.ScaleFactor(channel=channel, onset_s=at, factor=0.5),
    lambda channel, at: gb.Noise(channel=channel, onset_s=at, deviation=3.0),
    lambda channel, at: gb.SignFlip(channel=channel, onset_s=at),
    lambda channel, at: gb.Deadzone(channel=channel, onset_s=at, half_width=4.0),
    lambda channel, at: gb.Oscillation(channel=channel, onset_s=at, amplitude=3.0, frequency_hz=1.0),
)


def flight(seed, duration_s, rate_hz=100):
    """Return a healthy flight's readings, at twice the simulator's rate by splines where that is asked."""
    truth = gb.fly("gtm", "multisine+turbulence", duration_s, seed)
    if rate_hz != 100:
        time_s = np.arange(0.0, truth.end_s, 1.0 / rate_hz)
        values = CubicSpline(truth.time_s, truth.values)(time_s)
        truth = gb.Record(values, channels=truth.channels, sample_period_s=1.0 / rate_hz)
    return gb.measure(truth, noise="t2", seed=seed).select(CHANNELS)


def send(path, port, speed):
    """Send a saved link, each packet when it arrived."""
    arrived = list(in_tlog(Path(path).read_bytes()))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        begun_s = time.perf_counter()
        for at, packet in arrived:
            while (wait_s := (at - arrived[0][0]) / speed - (time.perf_counter() - begun_s)) > 0.0:
                time.sleep(min(wait_s, 0.002))
            sender.sendto(packet, ("127.0.0.1", port))


def by_udp(path, speed=1.0):
    """Watch a saved link that another process sends; return events, the link, latencies in ms and CPU in percent."""
    source = UdpSource("127.0.0.1", 0)
    link = gb.live(source, MONITOR, end_after_s=5.0)
    taken, latencies, first, last = link._take, [], [], []

    def take(delivery):
        if not first:
            first.extend([time.process_time(), time.perf_counter()])
        before, cpu_s = link._session._watcher.heard, time.thread_time()
        yield from taken(delivery)
        last[:] = [time.process_time(), time.perf_counter()]
        if link._session._watcher.heard > before:
            latencies.append((1e3 * (time.time() - delivery.arrived_s), 1e3 * (time.thread_time() - cpu_s)))

    link._take = take
    sender = multiprocessing.get_context("spawn").Process(target=_after, args=(path, source.port, speed))
    sender.start()
    events, _ = links.said(link)
    cpu, wall = last[0] - first[0], last[1] - first[1]  # but for the closing word
    sender.join()
    return events, link, latencies, 100.0 * cpu / wall


def _after(path, port, speed):
    time.sleep(4.0)  # the watch has warmed up
    send(path, port, speed)


def latency(folder):
    for rate_hz in (100, 200):
        record = gb.inject(flight(31, 70.0, rate_hz), gb.Bias(channel="q", onset_s=50.0, size=3.0))
        path = links.saved(folder / f"{rate_hz}.tlog", links.troubled(links.packets(record), seed=rate_hz))
        events, link, latencies, cpu = by_udp(path)
        first = next(event for event in events if event.kind == "alarm")
        again, _ = links.said(gb.live(str(path), MONITOR))
        yield {
            "rate_hz": rate_hz,
            "median_p99_largest_ms": np.percentile(latencies, [50, 99, 100], axis=0)[:, 0].round(3).tolist(),
            "of_cpu_ms": np.percentile(latencies, [50, 99, 100], axis=0)[:, 1].round(3).tolist(),
            "load": os.getloadavg()[0],
            "first_judgement_ms": 1e3 * (first.said_s - first.arrived_s),
            "cpu_percent": cpu,
            "same_as_saved": links.told(events) == links.told(again),
            "counts": str(link.counts),
        }


def lines(_folder):
    record = flight(32, 300.0)
    head = "time_s,p_deg_s,q_deg_s,r_deg_s,phi_deg,theta_deg,psi_deg\n"
    rows = np.column_stack([record.time_s, record.values])
    content = (head + "".join(",".join(f"{value:.9g}" for value in row) + "\n" for row in rows)).encode()
    reading, writing = os.pipe()

    def write():
        with os.fdopen(writing, "wb") as file:
            file.write(content)

    threading.Thread(target=write).start()
    link = gb.live(InputSource(reading), MONITOR)
    link._begin(link.monitor)
    link._begin = lambda _monitor: None
    begun_s, cpu_s = time.perf_counter(), time.process_time()
    links.said(link)
    wall_s, cpu_s = time.perf_counter() - begun_s, time.process_time() - cpu_s
    each = {"lines_per_s": len(record) / wall_s, "lines_per_cpu_s": len(record) / cpu_s}
    yield {**each, "verdict": link.verdict, "load": os.getloadavg()[0]}


def flights(folder):
    kept = wrong = detected = same = 0
    odd = []
    for number in range(40):
        channel = "pqr"[number % 3]
        fault = FAULTS[number % len(FAULTS)](channel, 50.0)
        sent = links.packets(gb.inject(flight(300 + number, 80.0, 200), fault))
        names = []
        for name, arrived in (("clean", sent), ("bad", links.troubled(sent, seed=number))):
            events, link = links.said(gb.live(str(links.saved(folder / f"{name}.tlog", arrived)), MONITOR))
            sensors = [event.alarm.sensor for event in events if event.kind == "named"]
            names.append(sensors[-1] if sensors else None)
            wrong += any(sensor != channel for sensor in sensors)
        kept += names[0] == names[1]
        detected += bool(link.alarms)
        same += names[1] == channel
        if names[0] != names[1]:
            odd.append([fault.kind, channel, *names])
    yield {"flights": 40, "detected": detected, "named": same, "named_as_clean": kept, "wrong": wrong, "odd": odd}


def slow(folder):
    for rate_hz in (4, 10, 25):
        record = gb.decimate(flight(33, 60.0), 100 // rate_hz)
        path = links.saved(folder / "slow.tlog", links.packets(record))
        events, _ = links.said(gb.live(str(path), MONITOR))
        yield {"rate_hz": rate_hz, "said_after_s": (events[0].time_s or 0.0) - 10.0, "text": events[0].text}
    for rate_hz in (10, 25):
        records = [gb.decimate(flight(seed, 200.0), 100 // rate_hz) for seed in range(50, 54)]
        monitor = gb.calibrate(records, bank=gb.load_bank("C-filtered" if rate_hz < 25 else "C"))
        record = gb.inject(gb.decimate(flight(34, 150.0), 100 // rate_hz), gb.Bias(channel="q", onset_s=100, size=4.0))
        path = links.saved(folder / "slow.tlog", links.packets(record))
        _, link = links.said(gb.live(str(path), monitor))
        yield {"rate_hz": rate_hz, "by_a_monitor_for_it": link.verdict}


def day(_folder, hours, speed=30.0):
    """Watch one long flight, faster than it flies."""
    source = UdpSource("127.0.0.1", 0)
    link = gb.live(source, MONITOR, end_after_s=60.0)
    sender = multiprocessing.get_context("spawn").Process(target=_long, args=(source.port, hours, speed))
    sender.start()
    kinds: dict[str, int] = {}
    sizes: list[tuple[int, int]] = []
    done = threading.Event()

    def look():
        while not done.wait(10.0):
            sizes.append((round((link._session.time_s or 0.0) / 60.0), _resident_mb()))

    threading.Thread(target=look, daemon=True).start()
    with link:
        for event in link:
            kinds[event.kind.value] = kinds.get(event.kind.value, 0) + 1
            if event.kind == "alarm":
                print(event, flush=True)
    done.set()
    sender.join()
    yield {
        "hours": hours,
        "speed": speed,
        "events": kinds,
        "verdict": link.verdict,
        "counts": str(link.counts),
        "minutes_and_mb": sizes[:: max(len(sizes) // 12, 1)],
    }


def _long(port, hours, speed):
    from gtmbench.link.sending import _packets

    # without its autopilot it lands
    looped = gb.fly_in_loop("gtm", "multisine+turbulence", 3600.0 * hours, 35, sensors="ideal")
    record, random = looped.sensed.select(CHANNELS), np.random.default_rng(1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        begun_s = time.perf_counter()
        for at, packet in _packets(record):
            while (wait_s := at / speed - (time.perf_counter() - begun_s)) > 0.0:
                time.sleep(min(wait_s, 0.002))
            if random.random() > 0.02:
                sender.sendto(packet, ("127.0.0.1", port))


def _resident_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() // 1_000_000


PARTS = {"latency": latency, "lines": lines, "flights": flights, "slow": slow, "day": day}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS))
    parser.add_argument("--hours", type=float, default=1.0, help="of the flight of a day")
    options = parser.parse_args()
    with TemporaryDirectory() as folder:
        for name in options.only:
            for row in day(folder, options.hours) if name == "day" else PARTS[name](Path(folder)):
                print(json.dumps({"part": name, **row}), flush=True)


if __name__ == "__main__":
    main()
