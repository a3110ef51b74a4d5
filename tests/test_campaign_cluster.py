"""A campaign on a Dask cluster: a real scheduler and workers on loopback, of which some die on the way."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import gtmbench as gb
from gtmbench.cluster import completed_on_cluster
from gtmbench.parts import read_parts
from gtmbench.study.campaign.conduct import conduct
from tests.campaigns import TINY, asserts, fails, loaded, results, written

pytest.importorskip("distributed", reason="no extra [scale]")

ROOT = Path(__file__).parent.parent
MORE = TINY.replace("1:8", "1:12")


class Cluster:
    """A scheduler and its workers, a process each."""

    def __init__(self, folder, *options, workers=2):
        self._file = folder / "scheduler.json"
        self._options = options
        self._processes = []
        self.scheduler = self._begin("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-show", "--no-dashboard")
        self.workers = [self._worker() for _ in range(workers)]

    @property
    def address(self):
        for _ in range(600):
            with contextlib.suppress(OSError, ValueError, KeyError):
                return json.loads(self._file.read_text())["address"]
            time.sleep(0.05)
        raise AssertionError("no scheduler")

    def _worker(self):
        return self._begin("worker", "--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")

    def _begin(self, what, *options):
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "dask", what, "--scheduler-file", self._file, *options, *self._options]
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._processes.append(process)
        return process

    def end(self):
        for process in self._processes:
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path):
    cluster = Cluster(tmp_path)
    yield cluster
    cluster.end()


def test_a_worker_that_is_killed_midway_changes_no_byte(cluster, tmp_path):
    campaign = loaded(tmp_path, MORE)
    finished = []

    def tell(step, done, _of):
        if step == "flights" and done == 3:
            finished.append(done)
            cluster.workers[0].send_signal(signal.SIGKILL)

    parts = conduct(campaign, tmp_path / "out", scheduler=cluster.address, progress=tell)
    assert finished == [3]
    assert cluster.workers[0].wait(10) == -signal.SIGKILL
    assert parts.todo() == ()
    conduct(campaign, tmp_path / "alone")
    assert results(tmp_path / "out") == results(tmp_path / "alone")


def test_a_scheduler_that_dies_costs_what_wasnt_finished_and_no_more(cluster, tmp_path):
    campaign = loaded(tmp_path, MORE)

    def tell(step, done, _of):
        if step == "flights" and done == 2:
            cluster.scheduler.kill()

    with pytest.raises(gb.GtmbenchError, match="is gone; what is finished stays: go on with --resume"):
        conduct(campaign, tmp_path / "out", scheduler=cluster.address, progress=tell)
    assert len(read_parts(tmp_path / "out").done()) >= 2
    assert conduct(campaign, tmp_path / "out", resume=True).todo() == ()


def test_what_a_worker_cant_do_is_one_line(cluster):
    with pytest.raises(gb.InputError, match="not 3"):
        list(completed_on_cluster(fails, [3], scheduler=cluster.address))
    with pytest.raises(gb.GtmbenchError, match=r"a worker couldn't do a task \(AssertionError: 3\)"):
        list(completed_on_cluster(asserts, [3], scheduler=cluster.address))


@pytest.mark.parametrize("address", ["nonsense", "tcp://", "udp://127.0.0.1:8786", "tcp://host", "tcp://h:1/\x1b[2J"])
def test_an_address_that_is_none_is_one_line(cli, tmp_path, address):
    code, out, err = cli("campaign", written(tmp_path), "--scheduler", address, "--out", "out")
    assert (code, out) == (2, "")
    assert "give tcp://HOST:PORT" in err
    assert err[:-1].isprintable()
    assert not (tmp_path / "out").exists()


def test_an_address_where_no_scheduler_answers_is_one_line(cli, tmp_path, monkeypatch):
    monkeypatch.setattr("gtmbench.cluster._PATIENCE_S", 1)
    code, out, err = cli("campaign", written(tmp_path), "--scheduler", "tcp://127.0.0.1:1", "--out", "out")
    assert (code, out) == (2, "")
    assert "no scheduler answers at" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_certificates_that_arent_there_are_told(cli, tmp_path):
    code, _, err = cli(
        "campaign", written(tmp_path), "--scheduler", "tls://127.0.0.1:1", "--tls", tmp_path, "--out", "o"
    )
    assert (code, "lacks ca.pem, cert.pem, key.pem" in err) == (2, True)


@pytest.fixture
def certificates(tmp_path):
    """Return a function that makes an authority of its own, and one certificate that it has signed, in a folder."""
    openssl = shutil.which("openssl") or pytest.skip("no openssl")

    def make(name):
        folder = tmp_path / name
        folder.mkdir()
        key = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes"
        (folder / "of.cnf").write_text("subjectAltName=IP:127.0.0.1")
        for command in (
            f"req -x509 {key} -subj /CN={name} -days 2 -keyout ca.key -out ca.pem",
            f"req {key} -subj /CN=127.0.0.1 -keyout key.pem -out asked.pem",
            "x509 -req -in asked.pem -CA ca.pem -CAkey ca.key -CAcreateserial -days 2 -extfile of.cnf -out cert.pem",
        ):
            subprocess.run([openssl, *command.split()], cwd=folder, check=True, capture_output=True)
        return folder

    return make


def test_by_tls_only_who_has_the_authority_s_certificate_is_let_in(certificates, tmp_path):
    """In processes of their own, which end in any case."""
    own, other = certificates("own"), certificates("other")
    files = ["--tls-ca-file", own / "ca.pem", "--tls-cert", own / "cert.pem", "--tls-key", own / "key.pem"]
    cluster = Cluster(tmp_path, "--protocol", "tls", *files, workers=1)
    try:
        assert cluster.address.startswith("tls://")
        path = written(tmp_path, TINY.replace("1:8", "1:2"))
        here = ["--scheduler", cluster.address, "--tls", own, "--out", tmp_path / "out"]
        command = [sys.executable, "-m", "gtmbench", "campaign", path, *here, "--quiet"]
        subprocess.run(command, cwd=ROOT, check=True, timeout=120)
        assert read_parts(tmp_path / "out").todo() == ()
        knock = (
            "import pathlib, sys, gtmbench.cluster as c\n"
            "c._PATIENCE_S = 2\n"
            "c.check_cluster(sys.argv[1], pathlib.Path(sys.argv[2]))"
        )
        refused = subprocess.run(
            [sys.executable, "-c", knock, cluster.address, other],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert "no scheduler answers at tls://" in refused.stderr
    finally:
        cluster.end()
