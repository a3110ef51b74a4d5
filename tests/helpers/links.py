"""Links as they are: what a sender sends of a record, lost, doubled, late, mixed; and what a monitor says of it."""

import tempfile
from pathlib import Path

import numpy as np

import gtmbench as gb
from gtmbench.link.packets import SavedLink, in_tlog

EVENTS = ("alarm", "named", "ended")


def packets(record):
    """Return when each packet of a record is sent, in seconds, and its bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "sent.tlog")
        gb.send_live(record, path)
        sent = list(in_tlog(path.read_bytes()))
    return [(at - sent[0][0] + 1e9, packet) for at, packet in sent]


def troubled(sent, *, seed=1, loss=0.02, doubled=0.01, jitter_s=0.012):
    """Return packets as a bad link delivers them: some lost, some twice, some late."""
    random = np.random.default_rng(seed)
    arrived = []
    for at, packet in sent:
        if random.random() < loss:
            continue
        late_s = random.uniform(0.0, jitter_s) if random.random() < 0.1 else 0.0
        arrived.append((at + late_s, packet))
        if random.random() < doubled:
            arrived.append((at + late_s + 0.002, packet))
    return sorted(arrived, key=lambda each: each[0])


def saved(path, arrived):
    """Write packets as a telemetry log."""
    with SavedLink(Path(path)) as link:
        for at, packet in arrived:
            link.put(at, packet)
    return Path(path)


def said(link):
    """Return all events of a link, and the link."""
    with link:
        return list(link), link


def told(events):
    """Return what of events has to be the same wherever a link is watched: which alarm, when, of which sensor."""
    return [
        (event.kind, event.time_s, event.fault, event.text, event.alarm and event.alarm.verdict)
        for event in events
        if event.kind in EVENTS
    ]
