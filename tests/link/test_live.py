"""A link is watched as a log is: the same alarms whatever it loses, and never a sensor accused for what it loses."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.attitude_filter import estimated_attitude
from gtmbench.link.packets import Packets, dialect, key_of
from gtmbench.link.source import Delivery, InputSource, LinkSource, UdpSource
from gtmbench.link.telemetry import Telemetry
from gtmbench.link.watcher import Watcher
from gtmbench.verdict.verdict import Outcome
from tests.helpers import links, monitors
from tests.helpers.night import by_day

BIAS = gb.Bias(channel="q", onset_s=45.0, size=4.0)


@cache
def sent(*, is_broken=True):
    record = monitors.record(3200, seed=21)
    return links.packets(gb.inject(record, BIAS) if is_broken else record)


class Given(LinkSource):
    """Deliveries as a test has them."""

    is_live, is_whole = False, True

    def __init__(self, arrived, *, one_by_one=False):
        super().__init__()
        self._arrived, self._one_by_one = arrived, one_by_one

    @property
    def waiting(self):
        return 0 if self._one_by_one else 1000

    def deliveries(self):
        for at, data, *peer in self._arrived:
            yield Delivery(at, data, *peer)


def watch(arrived, **options):
    one_by_one = options.pop("one_by_one", False)
    return links.said(gb.live(Given(arrived, one_by_one=one_by_one), monitors.monitor(), **options))


@cache
def plain():
    """Return what is said on the flight as it is sent."""
    return watch(sent())


def kinds(events):
    return [event.kind.value for event in events]


def test_a_fault_is_named_as_on_the_record():
    events, link = plain()
    stream = monitors.monitor().stream()
    record = gb.inject(monitors.record(3200, seed=21), BIAS)
    assert stream.push(record)
    named = [event for event in events if event.kind == "named"]
    assert kinds(events)[:2] == ["watching", "alarm"]
    assert [event.alarm.sensor for event in named][-1] == "q"
    assert link.outcome == Outcome.FAILED
    assert re.match(r"The pitch gyro \(q\) failed from \d+\.\d s on: bias ", link.verdict), link.verdict
    assert links.EVENTS  # what is compared below isn't empty
    assert abs(events[1].time_s - 10.0 - stream.alarms[0].time_s) < 0.2  # the sender's clock began 10 s earlier


@pytest.mark.nightly
def test_a_healthy_link_is_quiet():
    events, link = watch(links.troubled(sent(is_broken=False)))
    assert (kinds(events), link.outcome) == (["watching"], Outcome.HEALTHY)
    assert "No fault found" in link.verdict
    assert link.counts.lost > 100


@pytest.mark.parametrize(
    ("seed", "loss", "doubled", "jitter_s", "many"), by_day([(1, 0.0, 0.0, 0.0, 400), (2, 0.03, 0.02, 0.03, 1)], 0)
)
def test_a_saved_link_gives_the_same_alarms(seed, loss, doubled, jitter_s, many):
    """Rows and packets one by one, or together: alarms, times and names are the same, bit for bit."""
    arrived = links.troubled(sent(), seed=seed, loss=loss, doubled=doubled, jitter_s=jitter_s)
    first, link = watch(arrived, one_by_one=True)
    together = [
        (arrived[k][0], b"".join(packet for _, packet in arrived[k : k + many])) for k in range(0, len(arrived), many)
    ]
    again, other = watch(together)
    assert links.told(first)
    assert links.told(first) == links.told(again)
    assert (link.verdict, link.counts) == (other.verdict, other.counts)


@pytest.mark.nightly
def test_what_arrives_by_udp_and_what_is_saved_of_it_are_watched_alike(tmp_path):
    source = UdpSource("127.0.0.1", 0)
    path = tmp_path / "saved.tlog"
    link = gb.live(source, monitors.monitor(), save=path, end_after_s=2.5)

    def send():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for k, (_, packet) in enumerate(links.troubled(sent(), seed=5)):
                sender.sendto(packet, ("127.0.0.1", source.port))
                if k % 20 == 0:
                    time.sleep(0.002)

    sender = threading.Timer(2.0, send)
    sender.start()
    events, link = links.said(link)
    sender.join()
    assert link.counts.dropped == 0
    again, other = links.said(gb.live(str(path), monitors.monitor()))
    assert links.told(events)
    assert links.told(events) == links.told(again)
    assert other.counts == link.counts


@pytest.mark.parametrize("loss", by_day([0.0, 0.02], 0))
def test_the_whole_log_is_watched_alike(tmp_path, loss):
    """`monitor` of the file that a link was saved to alarms when `live` does, and names the same."""
    path = links.saved(tmp_path / "saved.tlog", links.troubled(sent(), seed=9, loss=loss))
    _, link = links.said(gb.live(str(path), monitors.monitor()))
    alarms = gb.watch_log(path, monitors.monitor()).alarms
    assert [alarm.time_s for alarm in alarms] == pytest.approx([alarm.time_s for alarm in link.alarms], abs=1e-9)
    assert [alarm.sensor for alarm in alarms] == [alarm.sensor for alarm in link.alarms] == ["q"]


@pytest.mark.nightly
def test_values_of_another_unit_are_never_watched_in_silence():
    """Gyros in rad/s that call themselves deg/s: healthy sensors, which a watch would accuse."""
    record = monitors.record(3200, seed=21)
    small = record
    for name in ("p", "q", "r"):
        small = small.replace(name, np.radians(record[name]))
    content = "\n".join(lines(small)).encode()
    (event,), link = of_input(content, monitors.monitor())
    assert link.outcome == Outcome.UNKNOWN
    assert event.kind == "cannot tell"
    assert event.text.startswith("p, q and r are 57 times too small: rad/s taken for deg/s; nothing is watched")


def without(arrived, start, stop, topic=None):
    """Return packets without those that are sent between two times, all or of one message."""
    packets = Packets()
    kept = []
    for at, packet in arrived:
        if start <= at - 1e9 < stop:
            found = packets.push(packet, is_whole=True)
            if topic is None or any(each.topic == topic for each in found):
                continue
        kept.append((at, packet))
    return kept


@pytest.mark.parametrize("topic", by_day(["ATTITUDE", "HIGHRES_IMU", None]))
def test_what_a_link_loses_is_no_sensors_fault(topic):
    arrived = without(sent(is_broken=False), 45.0, 51.0, topic)
    events, link = watch(arrived)
    assert "alarm" not in kinds(events)
    assert "named" not in kinds(events)
    expected = ["watching", "link lost", "link back"] if topic is None else ["watching", "cannot tell", "watching"]
    assert kinds(events) == expected
    assert link.outcome == Outcome.HEALTHY


@pytest.mark.nightly
def test_after_a_long_silence_watching_begins_anew():
    late = gb.Bias(channel="q", onset_s=57.0, size=4.0)
    arrived = without(links.packets(gb.inject(monitors.record(3500, seed=21), late)), 27.0, 39.0)
    events, _ = watch(arrived)
    assert kinds(events)[:5] == ["watching", "link lost", "link back", "note", "watching"]
    assert [event.alarm.sensor for event in events if event.kind == "named"][-1] == "q"


@pytest.mark.nightly
def test_a_reboot_is_said_and_the_clock_is_taken_anew():
    first = [each for each in sent(is_broken=False) if each[0] < 1e9 + 50.0]
    again = [(at + 51.0, packet) for at, packet in sent()]
    events, link = watch(first + again)
    assert kinds(events)[:3] == ["watching", "note", "watching"]
    assert "reboot" in events[1].text
    assert link.outcome == Outcome.FAILED


def test_two_senders_with_one_number_are_not_believed():
    other = links.packets(monitors.record(500, seed=5))
    mixed = sorted(sent(is_broken=False) + [(at + 5.0031, packet) for at, packet in other])
    events, link = watch(mixed)
    assert "two senders" in events[0].text
    assert kinds(events) == ["cannot tell", "note", "watching"]
    assert {"alarm", "named"}.isdisjoint(kinds(events))
    assert link.outcome != Outcome.FAILED


def test_of_two_systems_one_has_to_be_named():
    mavlink = dialect()
    other = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    extra = mavlink.MAVLink_attitude_message(5000, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0).pack(other)
    arrived = [sent()[0], (1e9, bytes(extra)), *sent()[1:]]
    events, link = watch(arrived)
    assert "--system 1" in events[0].text
    assert (kinds(events), link.outcome) == (["cannot tell"], Outcome.UNKNOWN)
    events, _ = watch(arrived[: len(arrived) // 2], system=1)
    assert "watching" in kinds(events)
    assert "system 7" in next(event.text for event in events if event.kind == "note")


def slower(rate_hz):
    record = monitors.record(600, seed=4)
    step = round(50.0 / rate_hz)
    slow = gb.Record(record.values[::step], channels=record.channels, sample_period_s=step * 0.02)
    return links.packets(slow)


@pytest.mark.parametrize("rate_hz", [4.0, 10.0])
def test_a_link_that_is_too_slow_says_within_three_seconds_which_rate_is_needed(rate_hz):
    (event,), link = watch(slower(rate_hz))
    assert event.kind == "cannot tell"
    assert event.time_s - 10.0 < 3.0
    assert "Hz: too seldom for this monitor, which watches at 50 Hz" in event.text
    assert link.outcome == Outcome.UNKNOWN


def test_signed_packets_are_read_and_others_refused(tmp_path):
    key_file = tmp_path / "key"
    key_file.write_text("a passphrase\n")
    key = key_of(key_file)
    mavlink = dialect()
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    sender.signing.secret_key, sender.signing.sign_outgoing, sender.signing.timestamp = key, True, 1
    message = mavlink.MAVLink_attitude_message(5000, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    packets = Packets(key)
    assert len(packets.push(bytes(message.pack(sender)), is_whole=True)) == 1
    assert packets.push(sent()[1][1], is_whole=True) == []
    assert packets.refused == 1
    events, link = watch(sent(), key=key)
    assert (events, link.outcome) == ([], Outcome.UNKNOWN)
    assert link.counts.refused > 1000


@pytest.mark.nightly
def test_random_bytes_are_passed_over():
    random = np.random.default_rng(3)
    dirty = [part for at, packet in sent() for part in ((at, random.bytes(40)), (at, packet))]
    events, _ = watch(dirty)
    clean, _ = plain()
    assert links.told(events) == links.told(clean)
    stream = b"".join(random.bytes(7) + packet for _, packet in sent()[:2000])
    packets = Packets()
    found = [each for k in range(0, len(stream), 100) for each in packets.push(stream[k : k + 100])]
    assert len(found) >= 1950
    assert len(packets._rest) <= 280


def lines(record):
    head = "time_s," + ",".join(f"{name}_{unit}" for name, unit in zip(NAMES, UNITS, strict=True))
    rows = np.column_stack([record.time_s, record.matrix(NAMES)])
    return [head, *(",".join(f"{value:.9g}" for value in row) for row in rows)]


NAMES, UNITS = ("p", "q", "r", "phi", "theta", "psi"), ("deg_s", "deg_s", "deg_s", "deg", "deg", "deg")


def of_input(content, monitor, **options):
    reading, writing = os.pipe()

    def write():
        with os.fdopen(writing, "wb") as file:
            file.write(content)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        return links.said(gb.live(InputSource(reading), monitor, **options))
    finally:
        writer.join()
        os.close(reading)


@pytest.mark.nightly
def test_lines_of_csv_give_the_alarms_of_the_record():
    record = gb.inject(monitors.record(3200, seed=21), BIAS)
    content = "\n".join(lines(record)).encode()
    events, link = of_input(content, monitors.monitor())
    assert link.outcome == Outcome.FAILED
    assert link.counts.read == len(record)  # the last line, too, which has no end
    broken = content.replace(b"\n30.0", b"\nnonsense\n30.0").replace(b"\n40.", b"\n,,\n40.", 1)
    again, other = of_input(broken, monitors.monitor())
    assert links.told(again) == links.told(events)
    assert other.counts.broken == 4 + 1


@pytest.mark.nightly
def test_lines_of_a_file_that_grows_give_the_same_alarms(tmp_path):
    """Nobody tells when a file grows, and half a line is none yet; a file that is begun anew ends the watch."""
    content = "\n".join(lines(gb.inject(monitors.record(3200, seed=21), BIAS))).encode() + b"\n"
    plain_events, _ = of_input(content, monitors.monitor())
    path = tmp_path / "flight.csv"
    path.write_bytes(content[:100_003])
    was_told = threading.Event()  # all that a whole file tells: a busy machine reads late

    def write():
        with path.open("ab") as file:
            for begin in range(100_003, len(content), 40_000):
                file.write(content[begin : begin + 40_000])
                file.flush()
                time.sleep(0.03)
        was_told.wait(60.0)
        path.write_bytes(b"time_s,p\n")

    writer = threading.Thread(target=write)
    writer.start()
    events = []
    with gb.live(f"follow:{path}", monitors.monitor()) as link:
        for event in link:
            events.append(event)
            if len(links.told(events)) == len(links.told(plain_events)):
                was_told.set()
    writer.join()
    assert links.told(events) == links.told(plain_events)
    assert link.outcome == Outcome.FAILED
    assert "has become shorter" in events[-1].text


@pytest.mark.nightly
@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a pseudo terminal")
def test_a_serial_line_gives_the_same_alarms():
    pytest.importorskip("serial")
    ours, theirs = os.openpty()
    arrived = sent()

    def write():
        for begin in range(0, len(arrived), 20):
            os.write(ours, b"".join(packet for _, packet in arrived[begin : begin + 20]))
        time.sleep(0.5)
        os.close(ours)

    link = gb.live(f"serial:{os.ttyname(theirs)}:115200", monitors.monitor(), end_after_s=3.0)
    writer = threading.Thread(target=write)
    writer.start()
    events, link = links.said(link)
    writer.join()
    os.close(theirs)
    clean, _ = plain()
    assert links.told(events) == links.told(clean)


@pytest.mark.parametrize(
    ("source", "told"),
    [
        ("serial:/dev/nothing:57600", "can't open serial:/dev/nothing:57600"),
        ("follow:nothing.csv", "no such file"),
        ("udp:127.0.0.1:70000", "ports are 1 to 65535"),
        ("udp:", "give udp:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD, follow:FILE.csv"),
    ],
)
def test_a_source_that_cannot_be_opened_is_told_in_a_line(source, told):
    with pytest.raises(gb.InputError, match=told) as raised:
        gb.live(source, monitors.monitor())
    assert "\n" not in str(raised.value)


def test_a_channel_that_a_sender_leaves_out_throughout_is_not_waited_for():
    """An autopilot without accelerometers sends NaN for them: each row is still given with its own message."""
    reader = Telemetry()
    watcher = Watcher(monitors.monitor(), reader)
    packets = links.packets(monitors.record(1000, seed=21).select(NAMES))
    messages = [message for _, packet in packets for message in reader.read(packet, None, is_whole=True)]
    given = []
    for message in messages:
        watcher.push([message])
        given.append((message.time_s, 0 if watcher._rows is None else watcher._rows._given))
    period_s = monitors.monitor().sample_period_s
    assert all("n" not in name[0] for own in watcher.routes.values() for name in own)
    late = [time_s - messages[0].time_s - (count - 1) * period_s for time_s, count in given[200:]]
    assert max(late) < 1.5 * period_s


def test_a_line_that_never_ends_is_dropped():
    table_lines = lines(monitors.record(200, seed=21))
    content = "\n".join(table_lines[:100]).encode() + b"9" * 300_000 + b"\n" + "\n".join(table_lines[100:]).encode()
    _, link = of_input(content, monitors.monitor())
    assert (link.counts.read, link.counts.broken) == (200 - 1, 1)


@pytest.mark.nightly
def test_a_monitor_is_learnt_from_the_first_span():
    record = gb.inject(monitors.record(3200, seed=21), BIAS)
    events, link = links.said(gb.live(Given(links.packets(record)), None, learn_s=30.0))
    assert kinds(events)[:4] == ["learning", "learning", "watching", "alarm"]
    assert 30.0 <= events[1].time_s - 10.0 < 31.0
    assert link.outcome == Outcome.FAILED
    assert re.match(r"The pitch gyro \(q\) failed from 5[45]\.\d s on: bias ", link.verdict), link.verdict


def test_what_cannot_be_learnt_from_is_said():
    still = gb.Record(np.zeros((2000, 6)), channels=NAMES, sample_period_s=0.02)
    events, link = links.said(gb.live(Given(links.packets(still)), None, learn_s=20.0))
    assert kinds(events)[:2] == ["learning", "cannot tell"]
    assert link.outcome == Outcome.UNKNOWN


@pytest.mark.nightly
def test_nothing_is_learnt_from_a_span_in_which_somebody_failed():
    """It would be taken for how the gyro is; the verdict at the end has it all the same."""
    early = gb.Bias(channel="q", onset_s=25.0, size=4.0)
    record = gb.inject(monitors.record(3200, seed=21), early)
    events, link = links.said(gb.live(Given(links.packets(record)), None, learn_s=50.0))
    assert [kinds(events)[0], kinds(events)[1]] == ["learning", "cannot tell"]
    assert re.search(r"yet: q failed since 3[3-7] s$", events[1].text), events[1].text
    assert re.match(r"The pitch gyro \(q\) failed from 3[4-6]\.\d s on: bias ", link.verdict), link.verdict


class Answered(Given):
    """A source that keeps what is sent back."""

    def __init__(self, arrived):
        super().__init__(arrived)
        self.sent = []

    def send(self, data):
        self.sent.append(data)


def answers(arrived, **how):
    """Return the messages that are sent back."""
    source, decoder = Answered(arrived), dialect().MAVLink(None)
    links.said(gb.live(source, monitors.monitor(), **how))
    return [decoder.decode(bytearray(packet)) for packet in source.sent]


@pytest.mark.parametrize("say", by_day([False, True]))
def test_what_is_sent_back(say):
    messages = answers(sent() if say else sent()[:1500], say=say)
    assert {message.get_type() for message in messages} == ({"HEARTBEAT", "STATUSTEXT"} if say else set())
    texts = [message.text for message in messages if message.get_type() == "STATUSTEXT"]
    assert all(text.startswith("gtmbench") and len(text) <= 50 for text in texts)
    assert len(texts) == len(set(texts))


def test_rates_are_asked_for_only_if_wanted():
    messages = answers(sent()[:50], request_hz=50.0)
    asked = {(message.get_type(), message.command, message.param2) for message in messages}
    assert asked == {("COMMAND_LONG", 511, 20000.0)}


@pytest.mark.nightly
def test_a_fault_has_at_most_twelve_lines():
    record = gb.inject(monitors.record(3200, seed=21), gb.Noise(channel="p", onset_s=45.0, deviation=3.0))
    events, _ = watch(links.packets(record))
    own = [event for event in events if event.fault == 0]
    assert 2 <= len(own) <= 12


def test_an_event_is_known_no_later_than_it_is_said():
    events, _ = plain()
    for event in events:
        assert event.said_s > 0.0
        assert event.table["text"] == event.text
        assert event.kind.value in str(event)
    alarm = next(event for event in events if event.kind == "alarm")
    assert alarm.time_s == alarm.alarm.time_s


def test_a_burst_beyond_what_can_wait_is_dropped_and_counted(monkeypatch):
    """Nobody takes what arrives: memory stays bounded, and the link says how much was lost."""
    monkeypatch.setattr("gtmbench.link.source._MOST_WAITING", 50)
    source = UdpSource("127.0.0.1", 0)
    deliveries = source.deliveries()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(b"first", ("127.0.0.1", source.port))
        assert next(each for each in deliveries if each is not None).data == b"first"
        for _ in range(500):
            sender.sendto(b"x" * 100, ("127.0.0.1", source.port))
            time.sleep(0.0005)
    deadline = time.monotonic() + 20.0
    while source.dropped < 450 and time.monotonic() < deadline:
        time.sleep(0.05)
    source.close()
    assert source.dropped == 450
    assert source.waiting == 0


def test_only_the_address_that_is_named_is_believed():
    source = UdpSource("127.0.0.1", 0, only="127.0.0.1:9")
    deliveries = source.deliveries()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(b"x", ("127.0.0.1", source.port))
    assert [next(deliveries) for _ in range(2)] == [None, None]
    source.close()


def test_without_the_library_nobody_waits(monkeypatch):
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20.ardupilotmega", None)
    with pytest.raises(gb.InputError, match=r"needs the package pymavlink; pip install 'gtmbench\[logs\]'"):
        gb.live("udp:127.0.0.1:0", monitors.monitor())


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("fault", "attitude"),
    [
        (gb.Bias(channel="q", onset_s=80.0, size=3.0), "filter 5 s"),
        (gb.Drift(channel="p", onset_s=80.0, slope=0.2), "filter 20 s"),
    ],
    ids=["bias of q", "drift of p"],
)
def test_a_gyro_that_bends_the_attitude_has_no_other_accused(fault, attitude, tmp_path):
    """Autopilots send an estimator's attitude; a monitor that was calibrated for another names the others after it."""
    truth = gb.fly("gtm", "multisine+turbulence", 160, seed=61)
    broken = gb.inject(gb.measure(truth, noise="t2", seed=61), fault)
    gb.send_live(estimated_attitude(broken, truth, attitude, 61), tmp_path / "bent.tlog")
    monitor = gb.load_monitor(Path(gb.__file__).parent / "baselines" / "bank-C.json")

    def named(**options):
        told, link = links.said(gb.live(str(tmp_path / "bent.tlog"), monitor, **options))
        assert link.outcome == Outcome.FAILED
        return {event.alarm.sensor for event in told if event.kind == "named"}, link

    names, link = named()
    assert names == {fault.channel}
    assert [alarm.sensor for alarm in link.alarms].count(fault.channel) == 1
    afterwards = gb.watch_log(tmp_path / "bent.tlog", monitor)
    of_bank = [alarm for watch in afterwards.watches for alarm in watch.faults]
    certain = [(alarm.time_s, alarm.sensor) for alarm in of_bank if alarm.is_first and alarm.accuses]
    assert certain == [(alarm.time_s, alarm.sensor) for alarm in link.alarms if alarm.accuses]
    believed, _ = named(attitude="own")
    assert believed >= names  # an attitude of its own leaves no doubt, and may leave others to name


@pytest.mark.nightly
def test_a_link_that_gets_better_is_watched_from_then_on():
    """As when an autopilot begins to send what it was asked for, or the computer was busy at the start."""
    (_, plain_link), arrived = plain(), sent()
    slow = [each for k, each in enumerate(arrived) if k > 1500 or k % 20 < 2]
    told, link = watch(slow)
    kinds = [event.kind for event in told]
    assert kinds[:2] == ["cannot tell", "watching"]
    assert "too seldom" in told[0].text
    assert [alarm.sensor for alarm in link.alarms] == [alarm.sensor for alarm in plain_link.alarms]


@pytest.mark.nightly
def test_what_a_link_loses_does_not_count_as_watched():
    """A healthy flight of which three quarters are lost from half-way on: no all-clear of the lost part."""
    arrived = sent(is_broken=False)
    half = len(arrived) // 2
    random = np.random.default_rng(3)
    told, link = watch([each for k, each in enumerate(arrived) if k < half or random.random() < 0.25])
    assert not [event for event in told if event.kind in ("alarm", "named")]
    assert link.watched_s < 0.65 * len(arrived) / 2 * 0.02


def since_1970(arrived, *, tells=True):
    """Return packets whose IMU counts its time since 1970; the autopilot tells when it was switched on, or not."""
    mavlink, packets, boot_us = dialect(), Packets(), 1_700_000_000_000_000
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    changed = []

    def pack(at, message):
        changed.append((at, bytes(message.pack(sender))))
        sender.seq = (sender.seq + 1) % 256

    for k, (at, packet) in enumerate(arrived):
        message = (packets.push(packet, is_whole=True) or [None])[0]
        if message is None:
            continue
        own = message.message
        if tells and k % 100 == 0:
            since_ms = round(1e3 * (at - arrived[0][0])) + 1
            pack(at, mavlink.MAVLink_system_time_message(boot_us + 1000 * since_ms, since_ms))
        if message.topic == "HIGHRES_IMU":
            own.time_usec += boot_us
        pack(at, own)
    return changed


def rounded(events):
    """Return what is told without how sure it is, whose last digit hangs on the clock's."""
    return [(*rest, re.sub(r" ± [0-9.]+", "", text), verdict) for *rest, text, verdict in links.told(events)]


@pytest.mark.nightly
def test_a_clock_since_1970_beside_one_since_boot(tmp_path):
    """An IMU may be stamped by either; SYSTEM_TIME tells how they go together, and without it that is said."""
    (events, _), arrived = plain(), sent()
    told, _ = watch(since_1970(arrived))
    assert rounded(told) == rounded(events) != []
    log = gb.open_log(links.saved(tmp_path / "told.tlog", since_1970(arrived)))
    np.testing.assert_allclose(
        log.segments[0]["q"], gb.open_log(links.saved(tmp_path / "t.tlog", arrived)).segments[0]["q"]
    )
    untold, _ = watch(since_1970(arrived, tells=False))
    assert {event.alarm.sensor for event in untold if event.kind == "named"} == {"q"}  # by ATTITUDE's rates
    assert not any("HIGHRES_IMU" in event.text for event in untold)
    reader = Telemetry()
    for _, packet in since_1970(arrived, tells=False)[:200]:
        reader.read(packet, is_whole=True)
    assert "HIGHRES_IMU counts time since 1970" in reader.told()
    saved = links.saved(tmp_path / "untold.tlog", since_1970(arrived, tells=False))
    assert any("SYSTEM_TIME" in note for note in gb.open_log(saved).method)


@pytest.mark.nightly
def test_ctrl_c_prints_the_verdict_on_what_arrived(tmp_path):
    """With the exit code of an interruption; what was saved is a whole log."""
    gb.save_monitor(monitors.monitor(), tmp_path / "monitor.json")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "gtmbench", "live", f"udp:127.0.0.1:{port}", "--detector", "monitor.json"]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where tests run in the background
    process = subprocess.Popen(
        [*command, "--save", "saved.tlog"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    signal.signal(signal.SIGINT, before)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        assert "listening" in process.stderr.readline()
        for k, (_, packet) in enumerate(sent()):
            sender.sendto(packet, ("127.0.0.1", port))
            if k % 10 == 0:
                time.sleep(0.002)
        said = ""
        while "named" not in said:
            said = process.stdout.readline()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, "")
    assert re.match(r"The pitch gyro \(q\) failed from \d+\.\d s on: bias ", out[out.index("The pitch") :]), out
    assert "\nlink: " in out
    assert gb.open_log(tmp_path / "saved.tlog").segments[-1].end_s > 54.0
