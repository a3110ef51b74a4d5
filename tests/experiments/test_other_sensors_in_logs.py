"""The study of other sensors in recorded logs: its rows of one simulated flight, as it is and broken."""

import pandas as pd
import pytest

import other_sensors_in_logs as study


@pytest.mark.nightly
def test_a_simulated_log_is_watched_broken_and_summed_up(tmp_path, monkeypatch):
    monkeypatch.setattr(study, "FLOWN_S", 150.0)
    monkeypatch.setattr(study, "SIZES", {name: study.SIZES[name] for name in ("tas", "nz", "mag_x")})
    (path,) = study.synthetic(tmp_path, range(61_001, 61_002))
    rows = pd.DataFrame(study.cases(path)).fillna({"fault": ""})
    clean, put = rows[rows["fault"] == ""], rows[rows["fault"] != ""]
    assert set(clean["sensor"]) == {"magnetometer", "gps", "accelerometers", "tas", "alpha", "beta", "altitude"}
    assert set(clean["said"]) == {"quiet"}
    assert len(put) == 4 * len(study.SIZES) + 1
    assert not (put["said"] == "wrong").any()
    assert (put["said"] == "named").any()
    assert not put["beside_clear"].any()
    assert "| named | either-or | late | wrong |" in "\n".join(study.report(rows))
