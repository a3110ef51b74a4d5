"""Damaged files of every format that a library reads: a log, or one line, within bounds; nothing in a file is run."""

import gzip
import os
import resource
import time
import zipfile
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.intake.formats.registry import read_raw
from tests.helpers import log_makers as makers
from tests.helpers.night import by_day
from tests.intake.test_intake_hostile import SEED, damaged, found_or_said

INPUTS = int(os.environ.get("GTMBENCH_DAMAGED", "25"))  # a format: 200 by GTMBENCH_DAMAGED=200
APART = 3  # times fewer of those that a process of its own reads: starting it takes longer than reading
READ_APART = ("flight.bag", "bag2", "flight.mat", "flight73.mat", "flight.xlsx")
IN_PLACE = [name for name in makers.MAKERS if name not in ("bag2", "tables")]


@cache
def whole(name):
    with TemporaryDirectory() as folder:
        path = makers.make(folder, name, makers.flight(4.0))
        return path.read_bytes() if path.is_file() else {each.name: each.read_bytes() for each in path.iterdir()}


def _processor_s():
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def put(folder, name, seed):
    """Write a damaged log of a format: of a folder's files one is."""
    path = Path(folder, name)
    content = whole(name)
    if isinstance(content, bytes):
        path.write_bytes(damaged(content, f"{SEED}{name} {seed}"))
        return path
    path.mkdir(exist_ok=True)
    for number, (own, told) in enumerate(sorted(content.items())):
        Path(path, own).write_bytes(damaged(told, f"{SEED}{name} {seed}") if number == seed % len(content) else told)
    return path


@pytest.mark.parametrize("name", by_day(makers.MAKERS))
def test_a_damaged_log_is_read_or_one_line(tmp_path, capfd, name):
    refused, slowest_s = 0, 0.0
    for seed in range(INPUTS // APART if name in READ_APART else INPUTS):
        path = put(tmp_path, name, seed)
        began_s = _processor_s()
        _, said = found_or_said(gb.open_log, path)
        refused += bool(said)
        slowest_s = max(slowest_s, _processor_s() - began_s)
        assert list(tmp_path.iterdir()) == [path]
    assert capfd.readouterr() == ("", "")
    assert refused > 0
    assert slowest_s < 5.0


def refused(path):
    """Return the line that refuses a log, and how many seconds and MB it took beside the file's."""
    began_s, before_kb = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(gb.InputError) as error:
        gb.open_log(path)
    took_s = time.perf_counter() - began_s
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb) / 1024
    assert took_s < 5.0
    assert grown < 300.0
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.nightly
def test_packed_files_that_unpack_without_end_are_refused(tmp_path):
    with gzip.open(tmp_path / "bomb.csv.gz", "wb") as file:
        for _ in range(64):
            file.write(bytes(1 << 22))
    assert "it unpacks to far more than its size" in refused(tmp_path / "bomb.csv.gz")
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("log.csv", bytes(1 << 28))
    assert "it unpacks to far more than its size" in refused(tmp_path / "bomb.zip")
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("p.npy", b"\x93NUMPY\x01\x00" + bytes(1 << 28))
    assert "far more than its size" in refused(tmp_path / "bomb.npz")


def test_names_that_climb_out_of_a_zip_and_links_lead_nowhere(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    table = makers.columns(makers.flight()).to_csv(index=False)
    with zipfile.ZipFile(inside / "log.zip", "w") as archive:
        archive.writestr("../../escaped.csv", table)
        link = zipfile.ZipInfo("link.csv")
        link.external_attr = 0o120777 << 16
        archive.writestr(link, "/etc/passwd")
    assert gb.open_log(inside / "log.zip").segments
    assert not (tmp_path.parent / "escaped.csv").exists()
    assert [path.name for path in tmp_path.rglob("*")] == ["inside", "log.zip"]


def test_a_zip_in_a_zip_is_opened_once(tmp_path):
    makers.zipped(tmp_path / "inner.zip", makers.flight())
    with zipfile.ZipFile(tmp_path / "outer.zip", "w") as archive:
        archive.write(tmp_path / "inner.zip", "inner.zip")
    assert "zip" in refused(tmp_path / "outer.zip")


def test_a_header_of_billions_of_rows_is_refused(tmp_path):
    import h5py

    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (4000000000,), }".ljust(117) + b"\n"
    with zipfile.ZipFile(tmp_path / "log.npz", "w") as archive:
        archive.writestr("p.npy", b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little") + header)
    assert "would be 4e+09 values" in refused(tmp_path / "log.npz")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file.create_dataset("p", shape=(4_000_000_000,), chunks=(1000,), dtype="f8")
    assert "would be 4e+09 values" in refused(tmp_path / "log.h5")


def test_a_group_that_holds_itself_and_links_out_of_a_file_are_passed_over(tmp_path):
    import h5py

    table = makers.columns(makers.flight())
    with h5py.File(tmp_path / "log.h5", "w") as file:
        group = file.create_group("flight")
        for name, column in table.items():
            group.create_dataset(name, data=column.to_numpy())
        group["again"] = group
        file["outside"] = h5py.ExternalLink("/etc/passwd", "/")
        file["soft"] = h5py.SoftLink("/flight")
    assert [series.name for series in read_raw(tmp_path / "log.h5").series] == [
        f"flight.{name}" for name in sorted(table.columns)
    ]


def nested(depth):
    """A .mat of cells in cells, so deep that its reader's stack overflows."""

    def tag(kind, size):
        return kind.to_bytes(4, "little") + size.to_bytes(4, "little")

    def head(kind, name):
        return (
            tag(6, 8) + kind.to_bytes(8, "little") + tag(5, 8) + (1).to_bytes(4, "little") * 2 + tag(1, len(name))
            + name.ljust(-(-len(name) // 8) * 8, b"\0")
        )  # fmt: skip

    inner = head(6, b"") + tag(9, 8) + bytes(8)
    parts, size = [tag(14, len(inner)) + inner], len(inner) + 8
    for level in range(depth):
        own = head(1, b"a" if level == depth - 1 else b"")
        size += len(own)
        parts.append(tag(14, size) + own)
        size += 8
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(reversed(parts))


def test_cells_in_cells_without_end_end_their_reader_and_nothing_else(tmp_path):
    (tmp_path / "deep.mat").write_bytes(nested(200_000))
    assert "isn't a readable MATLAB file" in refused(tmp_path / "deep.mat")


def test_pickles_in_an_archive_stay_closed(tmp_path):
    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "sprung"),)

    columns = {name: column.to_numpy() for name, column in makers.columns(makers.flight()).items()}
    np.savez(tmp_path / "log.npz", **columns, trap=np.array([Trap()], dtype=object), allow_pickle=True)
    log = gb.open_log(tmp_path / "log.npz")
    assert "left out, pickled objects: trap" in log.method
    assert not (tmp_path / "sprung").exists()
