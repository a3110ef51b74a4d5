"""The demo watches a flight while it flies, too; the one that writes a folder is run by `test_json_contract`."""

import json
from importlib.resources import files

import pytest
from jsonschema import Draft202012Validator

from gtmbench.cli import demo


@pytest.mark.nightly
def test_a_flight_is_watched_while_another_process_sends_it(cli, tmp_path, monkeypatch):
    shorter = demo.LIVE_FLIGHT.replace("--duration 90", "--duration 60").replace("--onset 60", "--onset 45")
    monkeypatch.setattr(demo, "LIVE_FLIGHT", shorter.replace("--speed 4", "--speed 8"))
    code, out, err = cli("demo", "--live", "--json")
    found = json.loads(out)
    Draft202012Validator(json.loads((files("gtmbench") / "schemas/demo.json").read_text())).validate(found)
    assert (code, found["verdict"]) == (0, "The broken gyro was found while it flew.")
    assert any("q failed; bias" in step["text"] for step in found["steps"])
    assert err == ""
    assert list(tmp_path.iterdir()) == []
