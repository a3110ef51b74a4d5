"""Every door where a file or bytes come in, what is whole there, and damaged files that once got through one.

`tests/damaged/` holds a description of each such file, never its bytes: the door, what was found, and how it differs
from what is whole there. `tests.fuzz` writes such a description of whatever it finds.
"""

import base64
import contextlib
import difflib
import hashlib
import io
import json
import signal
import tempfile
import time
import tomllib
import traceback
import warnings
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import gtmbench as gb
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.files.shipped import share
from gtmbench.link.source import Delivery, LinkSource
from tests.helpers import links, log_makers, monitors
from tests.intake.test_every_log_hostile import IN_PLACE
from tests.intake.test_every_log_hostile import whole as whole_log
from tests.intake.test_intake_hostile import FORMATS, damaged, whole

PACKAGE = Path(gb.__file__).parent
DAMAGED = Path(__file__).parent.parent / "damaged"
FILES: dict[str, tuple[Callable[[Path], object], Path]] = {
    "monitor.json": (gb.load_monitor, PACKAGE / "baselines/bank-C.json"),
    "scenario.toml": (gb.load_scenario, PACKAGE / "cli/template.toml"),
    "campaign.toml": (gb.load_campaign, share() / "experiments/campaigns/ci.toml"),
    "aircraft.toml": (lambda path: load_aircraft(path.parent), share() / "aircraft/gtm/aircraft.toml"),
}
# of a folder's files one is damaged
IN_FOLDERS = [
    "bag2/metadata.yaml",
    "bag2/bag2.db3",
    "tables/log_7_vehicle_attitude_0.csv",
    "tables/log_7_vehicle_angular_velocity_0.csv",
]
# of an archive's files one is damaged, and packed again: damage to the archive itself hardly gets past its checksums
IN_ARCHIVES = ["flight.xlsx/xl/worksheets/sheet1.xml", "flight.xlsx/xl/workbook.xml", "flight.npz/gyro_x_rad_s.npy"]
WATCHED = "watched.csv"  # read and judged to the end: what a strange flight does to the engine
TABLES = (WATCHED, "lines")  # damaged row by row as well: bytes hardly ever put a flight's rows in disorder
DOORS = [*FORMATS, *IN_PLACE, *IN_FOLDERS, *IN_ARCHIVES, *FILES, "link", "lines", WATCHED]
LINK_SAMPLES = 200
SIX = ("p", "q", "r", "phi", "theta", "psi")
WATCHED_SAMPLES = 3000  # a minute, of which every fifth is logged: a judgement takes a second
LONGEST_S = 10
LIMITS = ((signal.ITIMER_PROF, signal.SIGPROF, LONGEST_S), (signal.ITIMER_REAL, signal.SIGALRM, 12 * LONGEST_S))


class _Pieces(LinkSource):
    """Bytes as a link brings them, a few hundred at a time."""

    is_live = False

    def __init__(self, data: bytes, *, is_table: bool) -> None:
        super().__init__()
        self._data, self.is_table = data, is_table

    def deliveries(self):
        for number, place in enumerate(range(0, len(self._data), 300)):
            yield Delivery(1e9 + 0.1 * number, self._data[place : place + 300], ("127.0.0.1", 1))


class Door:
    """Where input comes in: what is whole there, and what takes it."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.folder = name, folder
        self.whole = whole_at(name)
        archive, _, self._member = name.partition("/") if name in IN_ARCHIVES else (name, "", "")
        self._path = folder / archive
        self._path.parent.mkdir(exist_ok=True)
        self._reads = FILES[name][0] if name in FILES else gb.open_log
        self._opened = self._path
        if name in IN_FOLDERS:
            self._opened = self._path.parent
            for own, content in whole_log(self._opened.name).items():
                (self._opened / own).write_bytes(content)

    def take(self, data: bytes) -> None:
        """Let it read some bytes."""
        if self.name in ("link", "lines"):
            with gb.live(_Pieces(data, is_table=self.name == "lines"), monitors.monitor()) as link:
                list(link)
            return
        self._path.write_bytes(_packed_again(whole_at(self._path.name), self._member, data) if self._member else data)
        self._reads(self._opened)
        if self.name == WATCHED:
            gb.watch_log(self._opened, "auto")


def _packed_again(archive: bytes, member: str, data: bytes) -> bytes:
    """Return an archive in which one file holds something else."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(archive)) as whole_one, zipfile.ZipFile(out, "w") as other:
        for own in whole_one.namelist():
            other.writestr(own, data if own == member else whole_one.read(own))
    return out.getvalue()


def tried(door: Door, data: bytes) -> str:
    """Return what went wrong at a door, by which it is told apart from other finds; "" where nothing did."""
    began_s = time.process_time()

    def ring(*_: object) -> None:
        raise TimeoutError

    # by the processor, for a machine may be busy; by the clock, for what waits takes none
    for which, alarm, longest_s in LIMITS:
        signal.signal(alarm, ring)
        signal.setitimer(which, longest_s)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(None), contextlib.redirect_stderr(None):
            warnings.simplefilter("ignore")
            door.take(data)
    except gb.GtmbenchError as error:
        if "\n" in str(error):
            return "an error of several lines"
    except (Exception, TimeoutError) as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} in {Path(frame.filename).name}:{frame.lineno}: {str(error)[:100]}"
    finally:
        for which, _, _ in LIMITS:
            signal.setitimer(which, 0.0)
    took_s = time.process_time() - began_s
    return f"it took {took_s:.0f} s" if took_s > LONGEST_S else ""


@cache
def whole_at(name: str) -> bytes:
    """Return what is whole at a door."""
    if name in FILES:
        content = FILES[name][1].read_bytes()
        if name.endswith(".json"):  # as older versions wrote it, without a digest, which would refuse all the rest
            document = json.loads(content)
            del document["digest"]
            content = json.dumps(document | {"version": 2}).encode()
        return content
    if name in ("link", *TABLES):
        record = monitors.record(LINK_SAMPLES, seed=21)
        if name == WATCHED:
            record = gb.decimate(monitors.record(WATCHED_SAMPLES, seed=21).select(SIX), 5)
        if name == "link":
            return b"".join(packet for _, packet in links.packets(record))
        with tempfile.TemporaryDirectory() as folder:
            gb.write_log(record, Path(folder, "lines.csv"))
            return Path(folder, "lines.csv").read_bytes()
    if name in FORMATS:
        return whole(name)
    if name in IN_FOLDERS:
        folder, _, own = name.partition("/")
        return whole_log(folder)[own]
    if name in IN_ARCHIVES:
        archive, _, member = name.partition("/")
        with zipfile.ZipFile(io.BytesIO(whole_at(archive))) as packed:
            return packed.read(member)
    with tempfile.TemporaryDirectory() as folder:
        return log_makers.make(folder, name, log_makers.flight(4.0)).read_bytes()


@dataclass(frozen=True)
class DamagedFile:
    """A file that once got through a door: where, what was found, and how it is made.

    Either ``seed`` says it, or ``replace`` (pairs of text), or ``edits`` (from, to, and in hexadecimal what stands
    there instead), or ``packed`` (all of it, by zlib and base64).
    """

    name: str
    door: str
    found: str
    seed: str = ""
    replace: tuple[tuple[str, str], ...] = ()
    edits: tuple[tuple[int, int, str], ...] = ()
    packed: str = ""

    def content(self, door: Door) -> bytes:
        """Return its bytes."""
        if self.packed:
            return zlib.decompress(base64.b64decode(self.packed))
        content = damaged(door.whole, self.seed) if self.seed else door.whole
        for was, now in self.replace:
            assert was.encode() in content, f"{self.name}: nothing reads {was!r}"
            content = content.replace(was.encode(), now.encode())
        for since, until, instead in reversed(self.edits):
            content = content[:since] + bytes.fromhex(instead) + content[until:]
        return content


def damaged_files() -> list[DamagedFile]:
    """Return all that are described."""
    return [DamagedFile(name=path.stem, **tomllib.loads(path.read_text())) for path in sorted(DAMAGED.glob("*.toml"))]


def described(door: Door, data: bytes, found: str) -> tuple[str, str]:
    """Return a name and a description for a damaged file, by what differs from what is whole."""
    lines = [f"door = {json.dumps(door.name)}", f"found = {json.dumps(found)}"]
    matcher = difflib.SequenceMatcher(None, door.whole, data, autojunk=len(data) > 10_000)
    parts = [part for part in matcher.get_opcodes() if part[0] != "equal"]
    edits = [f'    [{since}, {until}, "{data[a:b].hex()}"],' for _, since, until, a, b in parts]
    packed = base64.b64encode(zlib.compress(data, 9)).decode()
    lines += ["edits = [", *edits, "]"] if sum(map(len, edits)) < len(packed) else [f'packed = "{packed}"']
    return f"{hashlib.sha256(data).hexdigest()[:12]}-{door.name.replace('/', '-')}.toml", "\n".join(lines) + "\n"
