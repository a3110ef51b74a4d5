"""A fleet on a Dask cluster and in an object store: real ones, on loopback, and workers that die on the way."""

import contextlib
import socket
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

import gtmbench as gb
from gtmbench.intake.objects import fetched, object_digest, objects_in
from gtmbench.log.fleet import FleetQuestion, conduct
from gtmbench.log.watch import bank_between
from gtmbench.report.fleet import COLUMNS
from tests.helpers.clusters import Cluster, forget, row_or_kill, row_or_worse, small_logs
from tests.helpers.night import by_day

pytest.importorskip("distributed", reason="no extra [scale]")
SMALL = FleetQuestion(detector=bank_between(["p"], ["q"]), healthy=((0.0, 30.0),))


@pytest.fixture
def cluster(tmp_path):
    cluster = Cluster(tmp_path, nanny=True)
    yield cluster
    cluster.end()


@pytest.fixture(scope="module")
def bucket():
    """Return the address of an empty bucket of a store that runs meanwhile."""
    pytest.importorskip("moto", reason="no object store to try")
    pytest.importorskip("s3fs", reason="no extra [s3]")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    store = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    own = {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}",
        "AWS_ACCESS_KEY_ID": "anybody",
        "AWS_SECRET_ACCESS_KEY": "anything",
        "AWS_DEFAULT_REGION": "us-east-1",
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, value in own.items():
            patch.setenv(name, value)
        import s3fs

        for _ in range(200):
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1.0):
                break
            time.sleep(0.1)
        s3fs.S3FileSystem().mkdir("flights")
        yield "s3://flights"
    store.kill()
    store.wait()


@pytest.fixture
def stored(bucket, tmp_path):
    """Return the address of a folder with logs, and something else, in the store."""
    import s3fs

    system, folder = s3fs.S3FileSystem(), f"{bucket}/{tmp_path.name}"
    for path in small_logs(tmp_path, ["a10.csv", "a9.csv"]):
        system.put_file(str(path), f"{folder}/{path.name}")
    system.pipe_file(f"{folder}/notes.txt", b"no log")
    return folder


@pytest.mark.nightly
def test_a_worker_that_is_killed_changes_no_row(cluster, tmp_path):
    logs, killer, pages = small_logs(tmp_path, ["a.csv", "b.csv", "c.csv"]), tmp_path / "killer", []
    killer.touch()
    made = [
        conduct(
            logs,
            SMALL,
            tmp_path / name,
            row=partial(row_or_kill, killer=killer),
            keep=lambda log, page: pages.append((log.name, page)),
            columns=COLUMNS,
            scheduler=scheduler,
        )
        for name, scheduler in (("there", cluster.address), ("here", None))
    ]
    assert not killer.exists()
    assert made[0].read().equals(made[1].read())
    assert sorted(pages[:3]) == [(name, "page") for name in ("a.csv", "b.csv", "c.csv")]


@pytest.mark.nightly
def test_a_log_that_ends_its_process_is_a_row(cluster, tmp_path):
    logs = small_logs(tmp_path, ["dies.csv", "lasts.csv", "well.csv"])
    how = {"row": row_or_worse, "keep": forget, "columns": COLUMNS, "scheduler": cluster.address}
    rows = conduct(logs, replace(SMALL, limit_s=8.0), tmp_path / "out", **how).read().to_pylist()
    assert [row["outcome"] for row in rows] == ["error", "error", "healthy"]
    assert "was killed" in rows[0]["error"]
    assert "it took longer than 8 s" in rows[1]["error"]


@pytest.mark.nightly
def test_logs_in_a_store_are_rows_as_files_are(stored, cluster, tmp_path):
    how = {"out": tmp_path / "out", "healthy": [(0.0, 30.0)]}
    rows = gb.watch_fleet([stored], bank_between(["p"], ["q"]), scheduler=cluster.address, **how)
    assert rows["log"].tolist() == [f"{stored}/a9.csv", f"{stored}/a10.csv"]
    assert rows["outcome"].tolist() == ["healthy", "healthy"]
    here = gb.watch_fleet([tmp_path / "a9.csv"], bank_between(["p"], ["q"]), **how | {"out": tmp_path / "here"})
    there, alone = (each.iloc[0].drop(["task", "log"]).dropna().to_dict() for each in (rows, here))
    assert there == alone


def test_one_log_in_a_store_is_watched_without_a_fleet(stored, cli):
    code, out, _ = cli("monitor", f"{stored}/a9.csv", "--list")
    assert (code, "a9.csv" in out) == (0, True)


def test_an_object_is_told_by_what_it_holds(stored):
    import s3fs

    address = f"{stored}/a9.csv"
    before = object_digest(address)
    assert before == object_digest(address) != object_digest(f"{stored}/a10.csv")
    s3fs.S3FileSystem().pipe_file(address, b"another")
    s3fs.S3FileSystem.clear_instance_cache()
    assert object_digest(address) != before
    assert objects_in(f"{stored}/a*.csv") == [f"{stored}/a10.csv", f"{stored}/a9.csv"]
    with fetched(address) as path:
        assert (path.name, path.read_bytes()) == ("a9.csv", b"another")
    assert not path.exists()


@pytest.mark.parametrize(
    ("given", "why"),
    by_day(
        [
            ("s3://flights/nowhere", "there is no such object"),
            ("s3://nobody/a.csv", "there is no such object"),
            ("nobodys://flights/a.csv", "Protocol not known: nobodys"),
        ]
    ),
)
@pytest.mark.usefixtures("bucket")
def test_what_no_store_has_is_one_line(given, why, cli, tmp_path):
    code, out, err = cli("monitor", given, "--out", tmp_path / "out")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert why in err
    assert not Path(tmp_path / "out").exists()
