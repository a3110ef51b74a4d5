"""What SECURITY.md says and no other test holds; it names those that do."""

import socket

import pytest

import gtmbench as gb
from gtmbench.cli.app import main
from gtmbench.files.folders import SUMS
from gtmbench.link.opening import source_of
from gtmbench.link.source import Delivery, Source
from tests.helpers import links, monitors


@pytest.mark.parametrize("named", ["udp:0", "udp::0"])
def test_a_port_without_an_address_listens_on_this_machine_only(named):
    source = source_of(named)
    try:
        assert source._socket.getsockname()[0] == "127.0.0.1"
    finally:
        source.close()


def test_live_sends_nothing_unless_asked():
    class Heard(Source):
        is_live, is_whole, answers = False, True, []

        def deliveries(self):
            yield from (
                Delivery(at, data, ("127.0.0.1", 1)) for at, data in links.packets(monitors.record(400, seed=21))
            )

        def send(self, data):
            self.answers.append(data)

    with gb.live(Heard(), monitors.monitor()) as link:
        list(link)
    assert link.counts.read
    assert Heard.answers == []


def test_nothing_is_downloaded_or_sent_home(tmp_path, monkeypatch):
    """Watching and reporting a log opens no connection and asks for no name."""

    def forbidden(*_, **__):
        raise AssertionError("a connection")

    for name in ("connect", "connect_ex", "sendto", "bind"):
        monkeypatch.setattr(socket.socket, name, forbidden)
    monkeypatch.setattr(socket, "getaddrinfo", forbidden)
    gb.write_log(monitors.record(2000, seed=5).select(("p", "q", "r", "phi", "theta", "psi")), tmp_path / "log.csv")
    options = ["--report", str(tmp_path / "page.html"), "-q"]
    with pytest.raises(SystemExit) as ended:
        main(["monitor", str(tmp_path / "log.csv"), "--detector", "auto", *options])
    assert ended.value.code in (0, 3)


def test_a_list_of_digests_leads_out_of_no_folder(tmp_path, capsys):
    (tmp_path / "secret").write_text("x")
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / SUMS).write_text(f"{'0' * 64}  ../secret\n{'0' * 64}  /etc/passwd\n")
    with pytest.raises(SystemExit) as ended:
        main(["verify", str(tmp_path / "results")])
    assert ended.value.code == 1
    assert capsys.readouterr().out.count("names a file outside of its folder, which isn't read") == 2


def test_a_scenario_names_no_code_by_itself(tmp_path, capsys):
    (tmp_path / "evil.py").write_text("raise SystemExit(99)\n")
    scenario = 'title = "evil"\n[[faults]]\nkind = "evil:Fault"\nchannels = ["p"]\nonset_s = 20.0\n'
    (tmp_path / "evil.toml").write_text(scenario)
    with pytest.raises(SystemExit) as ended:
        main(["run", str(tmp_path / "evil.toml"), "--out", str(tmp_path / "out")])
    assert ended.value.code == 2
    assert "evil:Fault" in capsys.readouterr().err
