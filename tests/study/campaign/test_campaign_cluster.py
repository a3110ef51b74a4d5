"""A campaign on a Dask cluster: a real scheduler and workers on loopback, of which some die on the way."""

import contextlib
import importlib.metadata
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest

import gtmbench as gb
from gtmbench.jobs.cluster import check_cluster, completed_on_cluster
from gtmbench.jobs.parts import read_parts
from gtmbench.jobs.workers import versions
from gtmbench.study.campaign.conduct import conduct
from tests.helpers.campaigns import TINY, asserts, fails, loaded, results, written
from tests.helpers.clusters import ROOT, Cluster
from tests.helpers.hostile import refused

pytest.importorskip("distributed", reason="no extra [scale]")

MORE = TINY.replace("1:8", "1:12")


@pytest.fixture
def cluster(tmp_path):
    cluster = Cluster(tmp_path)
    yield cluster
    cluster.end()


@pytest.mark.nightly
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


@pytest.mark.nightly
def test_a_scheduler_that_dies_costs_what_wasnt_finished_and_no_more(cluster, tmp_path):
    campaign = loaded(tmp_path, MORE)

    def tell(step, done, _of):
        if step == "flights" and done == 2:
            cluster.scheduler.kill()

    with pytest.raises(gb.GtmbenchError, match="is gone; what is finished stays: go on with --resume"):
        conduct(campaign, tmp_path / "out", scheduler=cluster.address, progress=tell)
    assert len(read_parts(tmp_path / "out").done()) >= 2
    assert conduct(campaign, tmp_path / "out", resume=True).todo() == ()


@pytest.mark.nightly
def test_what_a_worker_cant_do_is_one_line(cluster):
    with pytest.raises(gb.InputError, match="not 3"):
        list(completed_on_cluster(fails, [3], scheduler=cluster.address))
    with pytest.raises(gb.GtmbenchError, match=r"a worker couldn't do a task \(AssertionError: 3\)"):
        list(completed_on_cluster(asserts, [3], scheduler=cluster.address))


@pytest.mark.parametrize("address", ["nonsense", "tcp://", "udp://127.0.0.1:8786", "tcp://host", "tcp://h:1/\x1b[2J"])
def test_an_address_that_is_none_is_one_line(cli, tmp_path, address):
    assert "give tcp://HOST:PORT" in refused(cli("campaign", written(tmp_path), "--scheduler", address, "--out", "out"))
    assert not (tmp_path / "out").exists()


def test_an_address_where_no_scheduler_answers_is_one_line(cli, tmp_path, monkeypatch):
    monkeypatch.setattr("gtmbench.jobs.cluster._PATIENCE_S", 1)
    assert "no scheduler answers at" in refused(
        cli("campaign", written(tmp_path), "--scheduler", "tcp://127.0.0.1:1", "--out", "out")
    )
    assert not (tmp_path / "out").exists()


def test_who_answers_nothing_or_something_else_is_told_in_time(monkeypatch):
    monkeypatch.setattr("gtmbench.jobs.cluster._PATIENCE_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        began = time.monotonic()
        with pytest.raises(gb.InputError, match=r"no scheduler answers at .*timed out"):
            check_cluster(f"tcp://127.0.0.1:{silent.getsockname()[1]}")
        assert time.monotonic() - began < 3.0
    with socket.create_server(("127.0.0.1", 0)) as other:

        def greet():
            with other.accept()[0] as caller:
                caller.sendall(b"220 mail here")

        threading.Thread(target=greet, daemon=True).start()
        with pytest.raises(gb.InputError, match="what answers isn't a scheduler of Dask"):
            check_cluster(f"tcp://127.0.0.1:{other.getsockname()[1]}")


@pytest.mark.nightly
def test_a_worker_with_another_version_is_refused_by_name(tmp_path):
    other = tmp_path / "other/scipy-0.0.1.dist-info"
    other.mkdir(parents=True)
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: scipy\nVersion: 0.0.1\n")
    cluster = Cluster(tmp_path, workers=1, path=f"{tmp_path / 'other'}:{ROOT}")
    try:
        campaign, out = loaded(tmp_path, TINY), tmp_path / "out"
        version = importlib.metadata.version("scipy")
        for _ in range(200):  # a worker has to come first
            with contextlib.suppress(gb.GtmbenchError):
                check_cluster(cluster.address, None, versions)
                time.sleep(0.1)
                continue
            break
        with pytest.raises(gb.InputError, match=rf"worker tcp://\S+ has scipy 0\.0\.1 instead of {version}; rows of"):
            conduct(campaign, out, scheduler=cluster.address)
        assert not out.exists()
    finally:
        cluster.end()


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


@pytest.mark.nightly
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
        with pytest.raises(gb.InputError, match=r"at tls://.* and --tls don't agree \(.*certificate"):
            check_cluster(cluster.address, other)
        with pytest.raises(gb.InputError, match=r"a scheduler at tls:// wants certificates; give --tls FOLDER"):
            check_cluster(cluster.address)
        plain = cluster.address.replace("tls://", "tcp://")
        with pytest.raises(gb.InputError, match=r"at tcp://.* wants TLS; give tls://... and --tls FOLDER"):
            check_cluster(plain)
        with pytest.raises(gb.InputError, match=r"--tls is for a scheduler at tls://; this one is at tcp://"):
            check_cluster(plain, own)
    finally:
        cluster.end()
