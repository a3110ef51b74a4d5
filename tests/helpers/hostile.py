"""Hostile files: damaged bytes, values that nobody means, and the count of what was tried."""

import contextlib
import resource
import time

from hypothesis import strategies as st

import gtmbench as gb

MOST_MB = 300.0

_NUMBERS = [0, -1, 2**31, 2**63, 10**30, 1e-320, 1e308, -1e308, float("inf"), float("-inf"), float("nan"), True]
_TEXTS = ["", " ", "\x1b[2J", "\u202e", "a\nb", "a\0b", "../../x", "/etc/passwd", "9" * 5000 + " % of rms", "p", "C"]
_LISTS = [[], {}, [[[[[[1]]]]]], [1] * 300, ["p", "p"], [5.0, 1.0], [float("nan"), 1.0], {"": {}}, [1, "a", {}]]
NASTY = st.sampled_from([*_NUMBERS, *_TEXTS, *_LISTS]) | st.integers() | st.floats() | st.text(max_size=40)
SNIPPETS = [
    b"[[[[",
    b"9" * 400,
    b"1e999",
    b"nan",
    b"\0",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b'"""',
    b"\x1b[31m",
    b"1979-05-27",
]


@st.composite
def damaged(draw, content):
    """Cut, flip, insert, double or remove bytes and lines, or write all in another encoding."""
    broken = bytearray(content)
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, max(len(broken) - 1, 0)))
        match draw(st.integers(0, 6)):
            case 0:
                del broken[place:]
            case 1:
                broken[place : place + 1] = draw(st.binary(min_size=1, max_size=1))
            case 2:
                broken[place:place] = draw(st.sampled_from(SNIPPETS))
            case 3:
                broken[place:place] = broken[place : place + 200]
            case 4:
                del broken[place : place + draw(st.integers(1, 60))]
            case 5:
                lines = bytes(broken).splitlines(keepends=True)
                lines[place % (len(lines) or 1) :][:1] = []
                broken = bytearray(b"".join(sorted(lines)))
            case 6:
                broken = bytearray(bytes(broken).decode("latin-1").encode(draw(st.sampled_from(["utf-16", "utf-8"]))))
    return bytes(broken)


@st.composite
def altered(draw, table):
    """Put a nasty value somewhere into a table of tables and lists, take something out, or add a key."""
    changed = _copied(table)
    for _ in range(draw(st.integers(1, 3))):
        holder, key = draw(st.sampled_from(_places(changed)))
        match draw(st.integers(0, 5)):
            case 0:
                del holder[key]
            case 1 if isinstance(holder, dict):
                holder[draw(st.sampled_from(["", "\x1b", "a.b", "title", "p", "x" * 300]))] = _copied(draw(NASTY))
            case _:
                holder[key] = _copied(draw(NASTY))
        if not _places(changed):
            break
    return changed


def _copied(value):
    if isinstance(value, dict):
        return {key: _copied(part) for key, part in value.items()}
    return [_copied(part) for part in value] if isinstance(value, list) else value


def _places(value):
    keys = value if isinstance(value, dict) else range(min(len(value), 20)) if isinstance(value, list) else ()
    own = [(value, key) for key in keys]
    return own + [place for key in keys for place in _places(value[key])]


class Tried:
    """Counts what a reader was given, and holds it to its limits."""

    def __init__(self, longest_s=5.0):
        self._longest_s = longest_s
        self.read = self.refused = 0
        self.slowest_s, self._before_mb = 0.0, _peak_mb()

    def __call__(self, reader, path):
        began, said = time.perf_counter(), None
        try:
            reader(path)
        except gb.GtmbenchError as error:
            said = str(error)
        self.read, self.refused = self.read + (said is None), self.refused + (said is not None)
        self.slowest_s = max(self.slowest_s, time.perf_counter() - began)
        assert said is None or 0 < len(said) < 4000, said
        assert self.slowest_s < self._longest_s

    def report(self, record_property):
        """Tell how many inputs there were, in JUnit's XML and on stdout (``pytest -rA`` shows it)."""
        inputs, grown_mb = self.read + self.refused, _peak_mb() - self._before_mb
        told = {"inputs": inputs, "read": self.read, "refused": self.refused, "slowest_s": round(self.slowest_s, 3)}
        for key, value in told.items():
            record_property(key, value)
        print(f"{inputs} inputs: {self.read} read, {self.refused} refused, at most {self.slowest_s:.2f} s")
        assert self.refused > 0.1 * inputs
        assert grown_mb < MOST_MB


def _peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


@contextlib.contextmanager
def unchanged(folder):
    """Assert that a folder and those above it hold what they held, and nothing else."""
    before = _listed(folder)
    yield
    assert _listed(folder) == before


def _listed(folder):
    return {path: path.lstat().st_mode for near in (folder, folder.parent) for path in near.iterdir()}


def refused(found, *, within=3000):
    """Assert that a command ended with exit code 2 and one line that a terminal shows as it is; return the line."""
    code, out, err = found
    assert (code, out) == (2, ""), found
    assert err.startswith("gtmbench: "), found
    assert err.endswith("\n")
    assert err[:-1].isprintable(), found
    assert len(err) < within
    return err
