"""The study of small UAVs on a model of our own: what flies is broken and named, what doesn't says why."""

import pytest

from gtmbench.bench import tuning
from gtmbench.errors import GtmbenchError
from tests.helpers.scripts import script
from tests.helpers.small_uav import write_uav

STUDY = script("small_uavs")


@pytest.fixture
def fleet(tmp_path, monkeypatch):
    monkeypatch.setattr(tuning, "_TRIED_S", 10.0)
    monkeypatch.setattr(tuning, "_PROVED_S", 20.0)
    monkeypatch.setattr(tuning, "delay_margin_s", lambda *_: 0.0)
    folder = write_uav(tmp_path, blades_ixx_kg_m2=4e-5).parent
    (folder / "torn").mkdir()
    (folder / "torn/torn.xml").write_text("<fdm_config name='torn'>")
    (folder / "notes").mkdir()
    return folder


@pytest.mark.nightly
def test_what_flies_is_broken_and_what_does_not_says_why(fleet):
    size = STUDY["Size"]((1, 2), (101,), 60.0, 40.0)
    models = STUDY["models_in"]([fleet])
    assert [model.name for model in models] == ["smallish", "torn"]
    flown, torn = (STUDY["tried"](STUDY["Task"](model, size)) for model in models)
    assert not flown.about["failed"], flown.about["why"]
    assert len(flown.trials) == 2 * 2 * 3  # in the record and in the loop, a drift and a jam of each gyro
    jams = [trial for trial in flown.trials if trial["fault"] == "jam" and trial["how"] == "record"]
    assert all(trial["detected"] and not trial["wrong"] for trial in jams), jams
    assert torn.about["failed"] == "load"
    assert torn.about["why"].startswith("torn.xml isn't whole XML")
    assert torn.trials == []


def test_a_folder_without_models_is_refused(tmp_path):
    with pytest.raises(GtmbenchError, match="no models in"):
        STUDY["models_in"]([tmp_path])
