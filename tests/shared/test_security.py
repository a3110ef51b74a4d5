"""What SECURITY.md says, sentence by sentence: which tests hold it, and those that stand nowhere else."""

import re
import socket
import tracemalloc
from itertools import chain
from pathlib import Path

import pytest

import gtmbench as gb
from gtmbench.files.folders import SUMS
from gtmbench.link.source import Delivery, LinkSource, source_of
from tests.helpers import links, monitors
from tests.intake.test_every_log_hostile import whole

TESTS = Path(__file__).parent.parent
HELD_BY = {  # the beginning of each sentence; nothing holds what is only whom users trust
    "Nothing in a log": [
        "shared/test_hostile_paths: no_module_runs_what_it_reads",
        "intake/test_every_log_hostile: pickles_in_an_archive_stay_closed",
    ],
    "They are data": ["shared/test_hostile: a_file_that_was_tampered_with_is_read_or_refused"],
    "No path in a log": [
        "shared/test_security: a_list_of_digests_leads_out_of_no_folder",
        "shared/test_security: a_bag_of_another_folders_database_is_refused",
        "intake/test_every_log_hostile: names_that_climb_out_of_a_zip_and_links_lead_nowhere",
        "intake/test_every_log_hostile: a_group_that_holds_itself_and_links_out_of_a_file_are_passed_over",
    ],
    "Scenarios, baselines and campaigns": [
        "check/test_check_file: scenarios_and_monitors_are_found_from_the_baselines_folder"
    ],
    "Sizes are bounded": [
        "intake/test_intake_hostile: a_file_that_is_too_large_isnt_opened",
        "intake/test_every_log_hostile: packed_files_that_unpack_without_end_are_refused",
        "shared/test_limits: messages_of_ever_other_fields_are_refused_within_seconds",
        "shared/test_security: a_flood_is_kept_nowhere",
        "link/test_order: memory_stays_bounded_whatever_is_missing",
    ],
    "What is wrong is said in one line": [
        "intake/test_intake_hostile: a_damaged_log_is_a_record_or_one_line",
        "intake/test_damaged_files: what_was_found_once_is_found_no_more",
    ],
    "Names that files give": [
        "report/test_notebook: what_files_and_users_call_things_is_escaped",
        "report/test_page: hostile_words_stay_words",
        "report/test_diff: what_others_recordings_call_things_is_no_markdown",
        "shared/test_hostile_paths: a_logs_name_commands_no_terminal",
        "intake/test_intake_hostile: names_that_a_terminal_would_obey_are_disarmed",
    ],
    "Python that you name is run": [
        "shared/test_imports: the_current_folder_is_searched_only_where_the_user_says_so",
        "faults/test_own_faults: a_scenario_imports_nothing",
    ],
    "A scenario or a baseline": [
        "shared/test_security: a_scenario_and_a_baseline_name_no_code_by_themselves",
    ],
    "A Dask scheduler": [],
    "Use TLS": ["study/campaign/test_campaign_cluster: by_tls_only_who_has_the_authority_s_certificate_is_let_in"],
    "An aircraft's folder": [],
    "A model that would": [
        "shared/test_hostile_paths: a_model_that_reaches_outside_is_refused",
        "bench/test_other_aircraft: sections_that_reach_outside_are_refused_or_left_out",
    ],
    "Ports listen": ["shared/test_security: a_port_without_an_address_listens_on_this_machine_only"],
    "`live` sends": ["shared/test_security: live_sends_nothing_unless_asked"],
    "Nothing is downloaded": ["shared/test_security: nothing_is_downloaded_or_sent_home"],
}


def test_every_sentence_names_its_tests():
    text = (TESTS.parent / "SECURITY.md").read_text()
    trusted = text.partition("## What is trusted")[2].partition("`tests/shared/")[0]
    sentences = re.split(r"(?<=\.) (?=[A-Z`])", " ".join(trusted.replace("**", "").replace("\n- ", " ").split()))
    assert [begins for begins, each in zip(HELD_BY, sentences, strict=True) if not each.startswith(begins)] == []
    for named in chain(*HELD_BY.values()):
        file, _, test = named.partition(": ")
        assert f"def test_{test}(" in (TESTS / f"{file}.py").read_text(), named


@pytest.mark.parametrize("named", ["udp:0", "udp::0"])
def test_a_port_without_an_address_listens_on_this_machine_only(named):
    source = source_of(named)
    try:
        assert source._socket.getsockname()[0] == "127.0.0.1"
    finally:
        source.close()


def test_live_sends_nothing_unless_asked():
    class Heard(LinkSource):
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


@pytest.mark.nightly
def test_nothing_is_downloaded_or_sent_home(cli, monkeypatch):
    """Watching and reporting a log opens no connection and asks for no name."""

    def forbidden(*_, **__):
        raise AssertionError("a connection")

    for name in ("connect", "connect_ex", "sendto", "bind"):
        monkeypatch.setattr(socket.socket, name, forbidden)
    monkeypatch.setattr(socket, "getaddrinfo", forbidden)
    gb.write_log(monitors.record(2000, seed=5).select(("p", "q", "r", "phi", "theta", "psi")), "log.csv")
    assert cli("monitor", "log.csv", "--detector", "auto", "--report", "page.html", "-q")[0] in (0, 3)


def test_a_list_of_digests_leads_out_of_no_folder(tmp_path, cli):
    (tmp_path / "secret").write_text("x")
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / SUMS).write_text(f"{'0' * 64}  ../secret\n{'0' * 64}  /etc/passwd\n")
    code, out, _ = cli("verify", "results")
    assert (code, out.count("names a file outside of its folder, which isn't read")) == (1, 2)


@pytest.mark.parametrize(
    ("command", "text", "said"),
    [
        ("run", 'title = "evil"\n[[faults]]\nkind = "evil:Fault"\nchannels = ["p"]\nonset_s = 20.0\n', "evil:Fault"),
        ("check", 'scenarios = ["jam"]\ndetector = "evil.py:Evil"\n', "a baseline imports no Python"),
    ],
)
def test_a_scenario_and_a_baseline_name_no_code_by_themselves(cli, command, text, said):
    Path("evil.py").write_text("raise SystemExit(99)\n")
    Path("mine.toml").write_text(text)
    code, _, err = cli(command, "mine.toml")
    assert code == 2
    assert said in err


def test_a_bag_of_another_folders_database_is_refused(tmp_path):
    (tmp_path / "bag2").mkdir()
    for name, content in whole("bag2").items():
        (tmp_path / "bag2" / name).write_bytes(content)
    (tmp_path / "bag2/bag2.db3").rename(tmp_path / "secret.db3")
    listed = tmp_path / "bag2/metadata.yaml"
    listed.write_text(listed.read_text().replace("bag2.db3", "../secret.db3"))
    with pytest.raises(gb.InputError, match="missing"):
        gb.open_log(tmp_path / "bag2")


class Flood(LinkSource):
    """Twenty megabytes of a link."""

    is_live = False

    def __init__(self, data, *, is_table):
        super().__init__()
        self._data, self.is_table = data, is_table

    def deliveries(self):
        yield from (Delivery(1e9 + 0.001 * number, self._data, ("127.0.0.1", 1)) for number in range(5000))


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("data", "is_table"), [(b"x" * 4000, True), (b"\xfd\xff" * 2000, False), (bytes(range(256)) * 16, False)]
)
def test_a_flood_is_kept_nowhere(data, is_table):
    tracemalloc.start()
    try:
        with gb.live(Flood(data, is_table=is_table), monitors.monitor()) as link:
            assert not list(link)
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()
