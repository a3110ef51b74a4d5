"""On a full disk the output is named, never the input, and nothing says that it was saved."""

import errno
import json
import os
import resource

import pytest

import gtmbench as gb
from tests.helpers import links, monitors
from tests.helpers.night import by_day

FULL = OSError(errno.ENOSPC, "No space left on device")


def full(*_, **__):
    raise FULL


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_inject_names_what_it_writes(suffix, tmp_path, cli, monkeypatch):
    gb.write_log(monitors.record(500, seed=5).select(("p", "q", "r")), tmp_path / f"log.{suffix}")
    writer = "gtmbench.intake.formats.csv_cells._write" if suffix == "csv" else "pyarrow.parquet.ParquetWriter"
    monkeypatch.setattr(writer, full)
    log, out = str(tmp_path / f"log.{suffix}"), str(tmp_path / f"broken.{suffix}")
    code, _, err = cli("inject", log, "--fault", "bias:q:size=3", "--onset", "3", "--attitude", "own", "--out", out)
    assert code == 2
    assert err == (
        f"gtmbench: can't write {out}: No space left on device; make room or choose another place; "
        "what stood there before still stands\n"
    )
    assert [path.name for path in tmp_path.iterdir()] == [f"log.{suffix}"]


def test_a_link_that_isnt_all_saved_isnt_called_saved(tmp_path, cli, monkeypatch):
    sent = links.saved(tmp_path / "sent.tlog", links.packets(monitors.record(400, seed=21)))
    gb.save_monitor(monitors.monitor(), tmp_path / "m.json")
    monkeypatch.setattr("gtmbench.link.packets._packet", full)
    saved = str(tmp_path / "kept.tlog")
    arguments = ["live", sent, "--detector", tmp_path / "m.json", "--save", saved, "--force"]
    code, out, err = cli(*arguments)
    assert code == 2
    assert f"not all saved: {saved}: No space left on device" in err
    assert "\nsaved: " not in out
    assert json.loads(cli(*arguments, "--json")[1].splitlines()[-1])["saved"] is None


@pytest.mark.parametrize(("size", "code"), by_day([(0.0, 2), (4.0, 1)], 0))
def test_a_link_that_isnt_all_recorded_isnt_called_so_and_ends_with_2_unless_something_failed(
    size, code, tmp_path, cli
):
    record = gb.inject(monitors.record(3000, seed=21), gb.Bias(channel="q", onset_s=45.0, size=size))
    sent, recorded = links.saved(tmp_path / "sent.tlog", links.packets(record)), tmp_path / "live.rrd"
    gb.save_monitor(monitors.monitor(), tmp_path / "m.json")
    allowed = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, allowed[1]))  # of every file, of the process that draws, too
    try:
        ended, out, err = cli("live", sent, "--detector", tmp_path / "m.json", "--record", recorded)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, allowed)
    assert f"not all recorded: {recorded}: {os.strerror(errno.EFBIG)}; it holds what came before" in err
    assert "recorded: " not in out
    assert ended == code


def test_a_folder_that_cant_be_made_is_named(cli, monkeypatch):
    monkeypatch.setattr("pathlib.Path.mkdir", full)
    code, _, err = cli("benchmark", "--quick", "--any-versions", "--detector", "limits", "--out", "scored")
    assert code == 2
    assert "can't write scored: No space left on device" in err
