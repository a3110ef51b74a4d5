"""Commands that watch the same log in the same way get what was said of it: that takes seconds, and is the same."""

from pathlib import Path

from gtmbench.detectors.bank.bank import Bank

MOST = 12  # that are kept
LARGEST_BYTES = 100_000_000


def remembered(watch_log):
    """Return `watch_log` with a memory of logs with the same names and bytes, watched alike; and its memory."""
    shelf = {}

    def watch(path, detector, *, healthy=(), progress=None, **how):
        told = {"progress": progress} if progress else {}
        try:
            key = _as_told(path), _detector(detector), *map(_part, healthy), repr(sorted(how.items()))
        except (TypeError, OSError, ValueError):  # what can't be told, or read
            return watch_log(path, detector, healthy=healthy, **told, **how)
        if key not in shelf:
            shelf[key] = watch_log(path, detector, healthy=healthy, **told, **how)
            if len(shelf) > MOST:
                del shelf[next(iter(shelf))]
        return shelf[key]

    return watch, shelf


def _as_told(path):
    if not Path(path).is_file() or Path(path).stat().st_size > LARGEST_BYTES:  # a pipe would be read for ever
        raise TypeError(path)
    return str(path), Path(path).read_bytes()


def _part(healthy):
    return healthy if isinstance(healthy, tuple) else _as_told(healthy)


def _detector(of):
    """Return a bank as it is, a name, or a monitor's file with its bytes; nobody's Python."""
    if isinstance(of, Bank):
        return repr(of)
    if not isinstance(of, (str, Path)) or ".py" in str(of):
        raise TypeError(of)
    return _as_told(of) if Path(of).is_file() else str(of)
