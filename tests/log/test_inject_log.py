"""A recorded flight, broken: the fault is in its column, and nothing else of the file has changed."""

import csv
import json
import random
from functools import cache

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.faults.fault import inject
from gtmbench.faults.kinds.additive import Drift
from gtmbench.faults.kinds.replacing import Jam
from gtmbench.faults.kinds.shaping import Deadzone, RateSaturation, Saturation
from gtmbench.faults.registry import FAULTS
from gtmbench.intake.contents import log_samples
from gtmbench.intake.formats.csv_cells import Notation
from gtmbench.log.breaking.inject import inject_log
from gtmbench.study.fault_tables import fault_specs
from tests.faults.test_several_faults import table
from tests.helpers.intake_files import ulog
from tests.helpers.night import by_day
from tests.intake.test_intake_hostile import whole

PERIOD_S, ROWS = 0.1, 60
TIME_S = np.round(PERIOD_S * np.arange(ROWS), 9)
UNIT = {"deg/s": 1.0, "rad/s": np.degrees(1.0), "mrad/s": np.degrees(1e-3), "cdeg/s": 0.01}
NOTE = ["ok", 'said "so"', "a;b, c\td", "", "Höhe"]


def flight(seed=1):
    """Return readings of p, r and psi: the heading runs through north."""
    draw = np.random.default_rng(seed)
    psi = 340.0 + np.cumsum(draw.normal(1.5, 1.0, ROWS))
    return {"p": draw.normal(0, 20, ROWS), "r": draw.normal(0, 5, ROWS), "psi": psi}


@st.composite
def layouts(draw):
    """A way of writing a table."""
    separator = draw(st.sampled_from([",", ";", "\t", "|"]))
    return {
        "separator": separator,
        "decimal": "," if separator != "," and draw(st.booleans()) else ".",
        "end": draw(st.sampled_from(["\n", "\r\n", "\r"])),
        "encoding": draw(st.sampled_from(["utf-8", "utf-8-sig", "latin-1", "utf-16"])),
        "unit": draw(st.sampled_from(list(UNIT))),
        "form": draw(st.sampled_from(["r", ".2f", ".6f", ".5g", ".9e"])),
        "units_row": draw(st.booleans()),
        "comments": draw(st.sampled_from([(), ("# logger 3, axis: right", '# "quoted" once'), ("% one",)])),
        "quoted": draw(st.booleans()),
        "blanks": draw(st.booleans()),
        "missing": draw(st.sets(st.integers(0, ROWS - 1), max_size=9)),
    }


def written(layout, readings):
    """Return a table's lines, its cells of p missing in some rows, with a column of notes and one that isn't used."""
    sep, unit = layout["separator"], layout["unit"]
    names = ["t" if layout["units_row"] else "t [s]", "p" if layout["units_row"] else f"p [{unit}]", "note", "spare"]

    def number(value):
        return (repr(float(value)) if layout["form"] == "r" else f"{value:{layout['form']}}").replace(
            ".", layout["decimal"]
        )

    def cell(text):
        return '"' + text.replace('"', '""') + '"' if layout["quoted"] or sep in text or '"' in text else text

    lines = [*layout["comments"], sep.join(names)]
    if layout["units_row"]:
        lines.append(sep.join(["s", unit, "", ""]))
    for k in range(ROWS):
        p = "" if k in layout["missing"] else number(readings["p"][k] / UNIT[unit])
        note = NOTE[k % len(NOTE)].replace("\t", " ")
        lines.append(sep.join([repr(float(TIME_S[k])).replace(".", layout["decimal"]), p, cell(note), " 007.10"]))
        if layout["blanks"] and k % 17 == 3:
            lines.append("")
    return lines


def faults_of(kind, onset_s, end_s):
    severities = {Drift: {"slope": 4.0}, Deadzone: {"half_width": 9.0}, Saturation: {"limit": 11.0}, Jam: {}}
    severities[RateSaturation] = {"rate_limit": 60.0}
    return kind(channel="p", onset_s=onset_s, duration_s=None if end_s is None else end_s - onset_s, **severities[kind])


STATED = st.builds(
    faults_of,
    st.sampled_from([Drift, Deadzone, Saturation, Jam, RateSaturation]),
    st.sampled_from([0.0, 1.0, 2.45, 5.9]),
    st.sampled_from([None, 6.0, 20.0]),
)


@pytest.mark.nightly
@settings(max_examples=60)
@given(layout=layouts(), fault=STATED, seed=st.integers(0, 99))
def test_of_a_csv_only_the_broken_columns_active_cells_change(tmp_path_factory, layout, fault, seed):
    log, out = tmp_path_factory.mktemp("csv") / "log.csv", tmp_path_factory.mktemp("csv") / "out.csv"
    assume(not (layout["missing"] and isinstance(fault, RateSaturation)))  # which goes by samples, not by time
    lines = written(layout, flight(seed))
    log.write_bytes(layout["end"].join([*lines, ""]).encode(layout["encoding"]))
    inject_log(log, out, fault)
    became = out.read_bytes().decode(layout["encoding"]).split(layout["end"])
    assert out.read_bytes()[:2] == log.read_bytes()[:2]
    assert len(became) == len(lines) + 1
    differ = [(was, now) for was, now in zip([*lines, ""], became, strict=True) if was != now]
    for was, now in differ:
        before, after = (next(csv.reader([line], delimiter=layout["separator"])) for line in (was, now))
        changed = [place for place in range(4) if before[place] != after[place]]
        time_s = float(before[0].replace(layout["decimal"], "."))
        assert changed == [1]
        assert fault.active(time_s)
    assert was_read(out, fault) == pytest.approx(
        expected(log, fault), abs=resolution(layout, [line for line in lines if line])
    )


def was_read(path, fault):
    """Return the broken channel's samples, in time."""
    return log_samples(path, [fault.channel])[fault.channel].values


def expected(log, fault):
    """Return what `inject` makes of the samples that are there, when they are."""
    samples = log_samples(log, [fault.channel])[fault.channel]
    there = np.rint(samples.time_s / PERIOD_S).astype(int)
    values = np.full(ROWS, np.nan)
    values[there] = samples.values
    held = values if not isinstance(fault, Jam) else filled(values)
    return inject(even(held), fault)["p"][there]


def filled(values):
    """Return values, each missing one that of the sample before: what a jam may begin from."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), -1))
    return np.where(last < 0, values[np.isfinite(values)][0], values[last])


def even(values):
    return gb.Record(values, channels=["p"], sample_period_s=PERIOD_S)


def resolution(layout, lines):
    """Return half the last decimal of a column, in deg/s; of one that has all, or exponents, next to nothing."""
    cells = [line.split(layout["separator"])[1].partition(layout["decimal"])[2] for line in lines[-ROWS:]]
    decimals = max(map(len, cells))
    return 1e-9 + (decimals < 15 and "e" not in "".join(cells)) * 0.5001 * 10.0**-decimals * UNIT[layout["unit"]]


@given(st.lists(st.floats(-1e3, 1e3), min_size=1), st.integers(0, 12))
def test_a_number_is_written_with_its_columns_decimals(values, decimals):
    notation = Notation.of([f"{value:.{decimals}f}" for value in values])
    assert notation.text(values[0]) == f"{values[0]:.{decimals}f}"
    assert Notation.of([f"{value:.{decimals}f}" for value in values], ",").text(0.5).count(".") <= (decimals == 0)


def test_a_column_with_exponents_or_all_digits_is_written_exactly():
    for column in (["1e-3", "0.5"], [repr(1 / 3)]):
        assert float(Notation.of(column).text(2 / 7)) == 2 / 7


TABLE = pa.table(
    {
        "time_s": pa.array(TIME_S),
        "p [rad/s]": pa.array(np.radians(flight()["p"]), pa.float32()),
        "r_deg_s": pa.array([None if k % 7 == 0 else v for k, v in enumerate(flight()["r"])]),
        "counts (mdps)": pa.array(np.rint(flight()["p"] * 1e3), pa.int32()),
        "note": pa.array([NOTE[k % 5] for k in range(ROWS)]).dictionary_encode(),
        "when": pa.array(np.rint(TIME_S * 1e9).astype(np.int64), pa.timestamp("ns")),
    }
).replace_schema_metadata({"logger": "three", "axes": "right"})
MAPPED = ["time=time_s:s"]


def parquet(path, **options):
    pq.write_table(TABLE, path, row_group_size=17, **options)
    return path


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"compression": "zstd"},
        {"compression": {"time_s": "gzip", "note": "snappy"}, "use_dictionary": ["note"]},
        {"compression": "none", "write_statistics": ["r_deg_s"], "version": "2.4", "coerce_timestamps": "us"}
        | {"allow_truncated_timestamps": True},
        {"version": "1.0", "store_schema": False, "use_dictionary": False},
    ],
)
def test_of_a_parquet_table_only_the_broken_columns_active_cells_change(tmp_path, options):
    log, out = parquet(tmp_path / "log.parquet", **options), tmp_path / "out.parquet"
    fault = Drift(channel="p", onset_s=2.0, duration_s=2.0, slope=3.0)
    inject_log(log, out, fault, mapping=["p=p [rad/s]:rad/s", *MAPPED])
    was, now = pq.read_table(log), pq.read_table(out)
    active = fault.active(TIME_S)
    for name in was.column_names:
        if name != "p [rad/s]":
            assert was[name].equals(now[name]), name
    before, after = (table["p [rad/s]"].to_numpy() for table in (was, now))
    assert before[~active].tobytes() == after[~active].tobytes()
    assert after[active] == pytest.approx(before[active] + np.radians(3.0 * (TIME_S[active] - 2.0)), abs=1e-6)
    assert pq.read_schema(log).equals(pq.read_schema(out), check_metadata=True)
    one, other = pq.read_metadata(log), pq.read_metadata(out)
    assert one.metadata == other.metadata
    assert one.format_version == other.format_version
    assert one.num_row_groups == other.num_row_groups == 4
    for number in range(4):
        groups = [metadata.row_group(number) for metadata in (one, other)]
        assert groups[0].num_rows == groups[1].num_rows
        for place in range(one.num_columns):
            columns = [group.column(place) for group in groups]
            for said in ("compression", "encodings", "physical_type", "is_stats_set", "path_in_schema"):
                assert len({str(getattr(column, said)) for column in columns}) == 1, said


def test_what_becomes_missing_is_null_and_what_was_stays(tmp_path):
    log, out = parquet(tmp_path / "log.parquet"), tmp_path / "out.parquet"
    inject_log(log, out, Gone(channel="r", onset_s=3.0), mapping=MAPPED)
    column = pq.read_table(out)["r_deg_s"]
    assert column.null_count == sum(k % 7 == 0 or TIME_S[k] > 2.9999 for k in range(ROWS))
    assert not np.isnan(column.drop_null().to_numpy()).any()


class Gone(Jam):
    """A sensor that tells nothing any more."""

    def distort(self, readings, elapsed_s, sample_period_s, carried):
        return np.full(len(readings), np.nan), carried


def test_whole_numbers_stay_whole_and_too_large_ones_are_refused(tmp_path):
    log, out = parquet(tmp_path / "log.parquet"), tmp_path / "out.parquet"
    mapping = ["p=counts (mdps):mdps", *MAPPED]
    inject_log(log, out, Saturation(channel="p", onset_s=0.0, limit=10.0005), mapping=mapping)
    counts = pq.read_table(out)["counts (mdps)"]
    assert counts.type == pa.int32()
    assert np.abs(counts.to_numpy()).max() == 10_000  # of two whole numbers as near, the even one
    out.unlink()
    with pytest.raises(InputError, match=r"column 'counts .mdps.' is int32, which can't hold"):
        inject_log(log, out, Drift(channel="p", onset_s=0.0, slope=1e8), mapping=mapping)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.parquet"]


def test_lines_that_are_no_plain_rows_stay_as_they_are(tmp_path):
    """Cells of several lines, comments between rows, short rows, lines of spaces, an end without a line end."""
    rows = [f'{t},"{t:.1f}",x\n' for t in TIME_S]
    rows[3] = f'{TIME_S[3]},"0.3","two\nlines, ""quoted"""\n'
    rows[5] = "   \n" + rows[5]
    rows[8] = "\n" + rows[8]
    rows[20] = "# paused\n" + rows[20]
    rows[30] = f"{TIME_S[30]}\n"
    rows[-1] = rows[-1].rstrip("\n")
    log, out = tmp_path / "log.csv", tmp_path / "out.csv"
    log.write_bytes(b"t [s],p [deg/s],note\n" + "".join(rows).encode() + b"\xff")
    inject_log(log, out, Jam(channel="p", onset_s=4.0))
    wanted = [row.replace(f'"{t:.1f}"', '"3.9"') if t > 3.99 else row for t, row in zip(TIME_S, rows, strict=True)]
    assert out.read_bytes() == b"t [s],p [deg/s],note\n" + "".join(wanted).encode() + b"\xff"


def test_between_spaces_a_missing_cell_says_so(tmp_path):
    log, out = tmp_path / "log.txt", tmp_path / "out.txt"
    log.write_text("# drop\n  t[s]   p[deg/s]\n" + "".join(f" {t:5.1f}  {t * 2:8.3f} \n" for t in TIME_S))
    inject_log(log, out, Gone(channel="p", onset_s=2.0))
    was, now = (path.read_text().splitlines() for path in (log, out))
    assert now[:22] == was[:22]
    assert now[22] == "   2.0     nan "


def test_a_cell_that_becomes_missing_is_left_empty(tmp_path):
    log, out = tmp_path / "log.csv", tmp_path / "out.csv"
    log.write_text("t [s],p [deg/s],n\n" + "".join(f'{t},"{t * 2:.3f}",7\n' for t in TIME_S))
    inject_log(log, out, Gone(channel="p", onset_s=5.85))
    assert out.read_text().splitlines()[-1] == '5.9,"",7'


@pytest.mark.parametrize("low", [0.0, -180.0, None])
def test_a_heading_keeps_to_the_turn_that_its_column_keeps_to(tmp_path, low):
    """Unwrapped it drifts; in the file it runs from 360 back to 0, or from 180 to -180, as it did."""
    psi = flight()["psi"]
    stored = psi if low is None else low + np.mod(psi - low, 360.0)
    log, out = tmp_path / "log.csv", tmp_path / "out.csv"
    log.write_text("t [s],psi [deg]\n" + "".join(f"{t},{y!r}\n" for t, y in zip(TIME_S, stored.tolist(), strict=True)))
    inject_log(log, out, Drift(channel="psi", onset_s=1.0, slope=20.0))
    rows = np.array([line.split(",") for line in out.read_text().splitlines()[1:]], dtype=float)
    if low is not None:
        assert rows[:, 1].min() >= low
        assert rows[:, 1].max() <= low + 360.0
    ramp = 20.0 * np.maximum(TIME_S - 1.0, 0.0)
    assert np.mod(rows[:, 1] - psi - ramp + 1.0, 360.0) == pytest.approx(1.0)
    turns = log_samples(out, ["psi"])["psi"].values - psi - ramp
    assert np.ptp(turns) < 1e-9  # as open_log reads it, whole turns off


def test_uneven_stamps_count_as_they_are(tmp_path):
    """A ramp grows with the stamps; a slew limit goes from sample to sample, by the nominal period."""
    stamps = np.cumsum(np.random.default_rng(3).uniform(0.05, 0.15, 400)).round(3)
    log, out = tmp_path / "log.csv", tmp_path / "out.csv"
    step = Drift(channel="p", onset_s=10.0, slope=0.5)
    log.write_text("t [s],p [deg/s]\n" + "".join(f"{t},0.0000\n" for t in stamps.tolist()))
    inject_log(log, out, step)
    assert was_read(out, step) == pytest.approx(0.5 * np.maximum(stamps - 10.0, 0.0), abs=5.1e-5)
    log.write_text("t [s],p [deg/s]\n" + "".join(f"{t},{100 * (t > 10):.4f}\n" for t in stamps.tolist()))
    inject_log(log, out, RateSaturation(channel="p", onset_s=1.0, rate_limit=2.0))
    steps = np.diff(was_read(out, step))
    assert set(steps[stamps[1:] > 10].round(3)) == {round(2.0 * float(np.median(np.diff(stamps))), 3)}


def test_of_stamps_from_1970_times_are_since_the_first_as_open_log_tells_them(tmp_path):
    log, out = tmp_path / "log.csv", tmp_path / "out.csv"
    stamps = 1_700_000_000_000 + np.rint(TIME_S * 1e3).astype(int)
    log.write_text("t [ms],p [deg/s]\n" + "".join(f"{t},1.5\n" for t in stamps.tolist()))
    (changed,) = inject_log(log, out, Drift(channel="p", onset_s=2.0, slope=10.0))
    assert (changed.first_s, changed.last_s) == (2.1, 5.9)
    assert out.read_text().splitlines()[21:23] == [f"{stamps[20]},1.5", f"{stamps[21]},2.5"]


def test_faults_act_one_after_the_other_on_one_channel_and_on_several(tmp_path):
    log, out = parquet(tmp_path / "log.parquet"), tmp_path / "out.parquet"
    ramp, clip = Drift(channel="p", onset_s=1.0, slope=9.0), Saturation(channel="p", onset_s=3.0, limit=5.0)
    jam = Jam(channel="r", onset_s=4.0)
    mapping = ["p=p [rad/s]:rad/s", *MAPPED]
    changed = inject_log(log, out, [ramp, clip, jam], mapping=mapping)
    assert [(each.channel, each.column) for each in changed] == [("p", "p [rad/s]"), ("r", "r_deg_s")]
    assert [(each.first_s, each.last_s) for each in changed] == [(1.1, 5.9), (4.0, 5.9)]
    was, now = (log_samples(path, ["p", "r"], mapping) for path in (log, out))
    assert now["p"].values == pytest.approx(inject(even(was["p"].values), [ramp, clip])["p"], abs=1e-5)
    stuck = now["r"].values[now["r"].time_s > 3.95]
    assert set(stuck) == {was["r"].values[was["r"].time_s < 3.95][-1]}


def test_a_column_that_is_filled_every_few_rows_breaks_where_it_is_filled(tmp_path):
    log, out = tmp_path / "log.csv", tmp_path / "out.csv"
    rows = [f"{t},{k},{k if k % 5 == 0 else ''}\n" for k, t in enumerate(TIME_S)]
    log.write_text("t [s],p [deg/s],psi [deg]\n" + "".join(rows))
    inject_log(log, out, Jam(channel="psi", onset_s=3.2))
    cells = [line.split(",")[2] for line in out.read_text().splitlines()[1:]]
    assert cells == [("" if k % 5 else str(min(k, 30))) for k in range(ROWS)]


@pytest.mark.parametrize("kind", by_day(FAULTS, 9, seed=78))
def test_of_every_kind_an_even_log_holds_what_inject_makes_of_the_record(tmp_path, kind):
    """Swapped channels included, those that are read beside, and faults that come and go."""
    log, out = tmp_path / "log.csv", tmp_path / "out.csv"
    draw = np.random.default_rng(8)
    gb.write_log(gb.Record(draw.normal(0, 5, (200, 3)), channels=["p", "q", "nz"], sample_period_s=0.02), log)
    more = {"onset_s": 1.0, "ramp_s": 0.5, "intermittent": {"period_s": 0.7, "duty": 0.6, "jitter": 0.1}}
    (spec,) = fault_specs("table", table(kind, channels=["p"], **more), 4.0)
    changed = inject_log(log, out, spec.fault)
    was, now = gb.read_log(log), gb.read_log(out)
    assert now.values.tobytes() == inject(was, spec.fault).values.tobytes()
    assert {each.channel for each in changed} == set(spec.fault.changes)
    assert sum(each.changed for each in changed) == np.count_nonzero(~(was.values == now.values))


@pytest.mark.parametrize("name", by_day(["log.csv", "log.parquet"]))
def test_a_damaged_log_is_broken_or_refused_in_one_line(tmp_path, name):
    log, out = tmp_path / name, tmp_path / f"out-{name}"
    for seed in range(60):
        draw, content = random.Random(seed), bytearray(whole(name))
        for _ in range(draw.randint(1, 5)):
            at = draw.randrange(len(content))
            content[at : at + draw.randint(0, 20)] = bytes(draw.choices(b'",;\n\r\t#-eE.\xff0', k=draw.randint(0, 4)))
        log.write_bytes(bytes(content))
        out.unlink(missing_ok=True)
        said = ""
        try:
            inject_log(log, out, Drift(channel="p", onset_s=2.0, slope=3.0))
        except InputError as error:
            said = str(error)
        assert "\n" not in said
        assert out.exists() == (not said)


REFUSED = {
    "no channel": (Jam(channel="q", onset_s=1.0), [], "no channel 'q'"),
    "too late": (Jam(channel="p", onset_s=6.5), [], "begins at 6.5 s, outside of log.csv, which runs from 0 to 5.9 s"),
    "no unit": (Jam(channel="r", onset_s=1.0), ["r=x"], "the column states no unit"),
    "twice": (
        [Jam(channel="p", onset_s=1.0), Jam(channel="q", onset_s=1.0)],
        ["q=p [deg/s]"],
        "column 'p .deg/s.' is mapped to p and q, and both break",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cant_be_broken_is_refused_and_nothing_is_written(tmp_path, case):
    faults, mapping, message = REFUSED[case]
    log = tmp_path / "log.csv"
    log.write_text("t [s],p [deg/s],x\n" + "".join(f"{t},{t},{t}\n" for t in TIME_S))
    with pytest.raises(InputError, match=message):
        inject_log(log, tmp_path / "out.csv", faults, mapping=mapping)
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


def test_a_format_that_is_only_read_becomes_a_csv_of_its_channels(tmp_path):
    log, out = tmp_path / "log.ulg", tmp_path / "out.csv"
    rows = [(k * 10_000, 0.1 * k, 0.0, 0.0) for k in range(500)]
    log.write_bytes(ulog({"vehicle_angular_velocity": (["float[3] xyz"], rows)}))
    inject_log(log, out, gb.Bias(channel="p", onset_s=1.0, size=2.0))
    was, now = (gb.open_log(path).segments[0] for path in (log, out))
    assert (now["q"] == was["q"]).all()
    assert np.abs(now["p"] - was["p"] - 2.0 * (was.time_s >= 1.0)).max() < 1e-9


SCENARIO = """
[[faults]]
kind = "drift"
channels = ["p", "q"]
onset_s = 43.0
slope = 0.5
[[faults.also]]
kind = "jam"
channel = "r"
onset_s = 50
end_s = 52
[[faults]]
kind = "deadzone"
channels = ["p"]
onset_s = 43.0
half_width = "50 % of rms"
"""


@cache
def minute():
    return gb.measure(gb.fly(excitation="multisine+turbulence", duration_s=60, seed=4), noise="t2", seed=4)


@pytest.fixture
def here(tmp_path):
    """A minute's log and a scenario, in the folder where the command line runs."""
    gb.write_log(minute(), tmp_path / "log.csv")
    (tmp_path / "two.toml").write_text(SCENARIO)
    return tmp_path


@pytest.mark.nightly
@pytest.mark.usefixtures("here")
def test_what_inject_breaks_monitor_finds(cli):
    own = ("--attitude", "own", "--out", "broken.csv", "--json")  # the simulation's attitude is of its own
    code, out, err = cli("inject", "log.csv", "--fault", "two.toml", "--trial", 2, *own)
    summary = json.loads(out)
    assert (code, err) == (0, "")
    assert (summary["trial"], summary["out"]) == (2, "broken.csv")
    assert [(fault["fault"], fault["channel"]) for fault in summary["faults"]] == [("drift", "q"), ("jam", "r")]
    assert [(each["column"], each["changed"]) for each in summary["columns"]] == [("q_deg_s", 1700), ("r_deg_s", 200)]
    said = {"follows": False, "time_constant_s": None, "time_constant": None, "why": "it was asked for"}
    assert summary["attitude"] == said
    broken = gb.watch_log("broken.csv", "C", healthy=[(0.0, 40.0)], attitude="own")
    assert [(each.verdict, each.last.kind) for each in broken.alarms] == [("q failed", "drift"), ("r failed", "jam")]
    assert broken.outcome == 1


FIRST_TRIAL = [Drift(channel="p", onset_s=43.0, slope=0.5), Jam(channel="r", onset_s=50.0, duration_s=2.0)]


@pytest.mark.usefixtures("here")
def test_an_attitude_that_follows_is_what_inject_makes_of_the_record_by_the_same_estimator(cli):
    for follows in (
        ("follows:2.5",),
        ("follows", "--time-constant-s", "2.5"),
        ("follows:9", "--time-constant-s", "2.5"),
    ):
        how = ("--attitude", *follows, "--out", "broken.csv", "--force")
        code, out, err = cli("inject", "log.csv", "--fault", "two.toml", "--trial", "1", *how)
        assert (code, err) == (0, "")
        assert "follows the fault: an estimator with a time constant of 2.5 s (as given) computes it" in out
        log, estimator = gb.read_log("log.csv"), gb.AttitudeEstimator(time_constant_s=2.5)
        bent = inject(log, FIRST_TRIAL, attitude=estimator)
        assert np.abs(gb.read_log("broken.csv").values - bent.values).max() < 1e-6
        assert np.abs(bent["phi"] - log["phi"]).max() > 5.0


@pytest.mark.usefixtures("here")
def test_by_default_an_attitude_of_which_nothing_shows_otherwise_follows_with_an_assumed_time_constant(cli):
    taken = ("--out", "taken.csv", "--json")
    summary = json.loads(cli("inject", "log.csv", "--fault", "two.toml", "--trial", "1", *taken)[1])
    assert [each["column"] for each in summary["columns"]] == ["p_deg_s", "r_deg_s", "phi_deg", "theta_deg", "psi_deg"]
    said = summary["attitude"]
    assert (said["follows"], said["time_constant_s"], said["time_constant"]) == (True, 5.0, "assumed")
    assert "assumed, as most are" in said["why"]
    bent = inject(gb.read_log("log.csv"), FIRST_TRIAL, attitude=gb.AttitudeEstimator(time_constant_s=5.0))
    assert np.abs(gb.read_log("taken.csv").values - bent.values).max() < 1e-6


@pytest.mark.usefixtures("here")
def test_of_an_attitude_of_its_own_only_the_gyros_cells_change(cli, here):
    """Byte for byte: what stands beside a broken gyro is what stood there; they are what the record's would be."""
    own = ("--attitude", "own", "--out", "broken.csv", "-q")
    assert cli("inject", "log.csv", "--fault", "two.toml", "--trial", "1", *own) == (0, "", "")
    assert (gb.read_log("broken.csv").values == inject(gb.read_log("log.csv"), FIRST_TRIAL).values).all()
    was, now = ((here / name).read_bytes().split(b"\n") for name in ("log.csv", "broken.csv"))
    gyros = {was[0].split(b",").index(name) for name in (b"p_deg_s", b"r_deg_s")}
    for before, after in zip(was, now, strict=True):
        cells = zip(before.split(b","), after.split(b","), strict=True)
        assert {place for place, (old, new) in enumerate(cells) if old != new} <= gyros


def test_faults_of_the_attitude_act_on_what_the_estimator_made(tmp_path):
    log, estimator = level(tmp_path / "log.csv"), gb.AttitudeEstimator(time_constant_s=4.0)
    faults = [gb.Bias(channel="p", onset_s=2.0, size=5.0), Jam(channel="phi", onset_s=8.0)]
    inject_log(log, tmp_path / "out.csv", faults, attitude=estimator)
    bent = inject(gb.read_log(log), faults, attitude=estimator)
    now = gb.read_log(tmp_path / "out.csv")
    assert np.abs(now.values - bent.values).max() < 1e-6
    assert now["phi"][-1] > 10.0


def test_a_gap_is_integrated_over_and_a_roll_goes_round(tmp_path):
    log, estimator = level(tmp_path / "log.csv"), gb.AttitudeEstimator(time_constant_s=100.0)
    whole_log = log.read_text().splitlines(keepends=True)
    stamps = np.array([float(line.split(",")[0]) for line in whole_log[1:]])
    kept = np.flatnonzero((stamps < 4.0) | (stamps > 7.0))
    log.write_text("".join([whole_log[0], *(whole_log[k + 1] for k in kept)]))
    inject_log(log, tmp_path / "out.csv", gb.Bias(channel="p", onset_s=2.0, size=30.0), attitude=estimator)
    phi = pd.read_csv(tmp_path / "out.csv")["phi_deg"].to_numpy()
    since_s = np.maximum(stamps[kept] - 2.0, 0.0)
    bend = 3000.0 * (1.0 - np.exp(-since_s / 100.0))
    assert bend.max() > 200.0
    assert np.abs(phi).max() <= 180.0
    assert np.abs(np.mod(phi - bend + 180.0, 360.0) - 180.0).max() < 0.4


def test_a_gyro_that_is_lost_leaves_the_attitude_with_its_last_rate(tmp_path):
    log, estimator = level(tmp_path / "log.csv", r=2.0), gb.AttitudeEstimator(time_constant_s=4.0)
    inject_log(log, tmp_path / "out.csv", Gone(channel="r", onset_s=5.0), attitude=estimator)
    was, now = pd.read_csv(log), pd.read_csv(tmp_path / "out.csv")
    assert now["r_deg_s"].isna().sum() == np.count_nonzero(was["time_s"] >= 5.0)
    assert now["psi_deg"].to_numpy() == pytest.approx(was["psi_deg"].to_numpy(), abs=1e-4)  # it turned steadily


def level(path, **rates):
    """Write ten seconds of steady level flight, with all digits that noise has."""
    time_s = np.round(np.arange(501) * 0.02, 9)
    noise = np.random.default_rng(4).normal(0.0, 1e-6, (501, 6))
    rates = {"p": 0.0, "q": 0.0, "r": 0.0, **rates}
    columns = {name: np.full(len(time_s), value) for name, value in rates.items()}
    columns |= {"phi": 0.0 * time_s, "theta": 0.0 * time_s, "psi": 40.0 + rates["r"] * time_s}
    channels = list(columns)
    values = np.column_stack(list(columns.values())) + noise
    gb.write_log(gb.Record(values, channels=channels, sample_period_s=0.02), path)
    return path


def test_an_attitude_of_its_own_stamps_that_wraps_keeps_them_and_how_it_wraps(tmp_path):
    """Gyros at 100 Hz, attitude at 20 Hz and a little off their stamps, a heading through north."""
    fast_s, slow_s = np.arange(3000) * 0.01, np.arange(600) * 0.05 + 0.003
    rows = pd.concat(
        [
            pd.DataFrame({"t [s]": fast_s, "p [deg/s]": 0.0, "q [deg/s]": 0.0, "r [deg/s]": 2.0}),
            pd.DataFrame(
                {"t [s]": slow_s, "roll [deg]": 0.0, "pitch [deg]": 0.0, "yaw [deg]": (330 + 2 * slow_s) % 360}
            ),
        ]
    ).sort_values("t [s]")
    rows.to_csv(tmp_path / "log.csv", index=False, float_format="%.6f")
    estimator = gb.AttitudeEstimator(time_constant_s=4.0)
    step = gb.Bias(channel="r", onset_s=10.0, size=3.0)
    changed = inject_log(tmp_path / "log.csv", tmp_path / "out.csv", step, attitude=estimator)
    was, now = (pd.read_csv(tmp_path / name) for name in ("log.csv", "out.csv"))
    assert (was["t [s]"] == now["t [s]"]).all()
    assert (was.isna() == now.isna()).all().all()
    yaw, before = now["yaw [deg]"].dropna(), was["yaw [deg]"].dropna()
    assert yaw.between(0.0, 360.0).all()
    bend = np.mod(yaw - before + 180.0, 360.0) - 180.0
    expected = np.where(slow_s > 10.0, 12.0 * (1.0 - np.exp(-(slow_s - 10.0) / 4.0)), 0.0)
    assert np.abs(bend - expected).max() < 0.05
    assert {each.channel for each in changed} == {"r", "phi", "theta", "psi"}


def test_an_attitude_in_quaternions_becomes_angles_and_its_gyro_is_broken_alone(tmp_path):
    log, out = tmp_path / "log.csv", tmp_path / "out.csv"
    log.write_text("t [s],p [deg/s],qw,qx,qy,qz\n" + "".join(f"{t},1.0,1.0,0.0,0.0,0.0\n" for t in TIME_S))
    bias = gb.Bias(channel="p", onset_s=2.0, size=1.0)
    assert {each.channel for each in inject_log(log, tmp_path / "angles.csv", bias)} == {"p", "phi", "theta", "psi"}
    assert (tmp_path / "angles.csv").read_text().startswith("time_s,p_deg_s,")
    assert [each.channel for each in inject_log(log, out, bias, attitude="own")] == ["p"]


@pytest.mark.usefixtures("here")
def test_a_bent_attitude_beyond_euler_angles_and_a_log_without_one_are_refused_in_a_line(cli, here):
    (here / "huge.toml").write_text('[[faults]]\nkind = "bias"\nchannels = ["q"]\nonset_s = 5.0\nsize = 60.0\n')
    level(here / "level.csv")  # of a banked aircraft a pitch rate turns the nose aside before it points up
    code, _, err = cli("inject", "level.csv", "--fault", "huge.toml", "--out", "x.csv", "--attitude", "follows")
    assert (code, err.count("\n")) == (2, 1)
    assert "theta reaches" in err
    gb.write_log(gb.read_log("log.csv").select(["p", "q", "r"]), here / "rates.csv")
    code, _, err = cli("inject", "rates.csv", "--fault", "huge.toml", "--out", "x.csv", "--attitude", "follows")
    assert (code, err.count("\n")) == (2, 1)
    assert "no attitude can follow, for the log has no phi and no theta" in err
    assert not (here / "x.csv").exists()
    assert cli("inject", "rates.csv", "--fault", "huge.toml", "--out", "x.csv", "-q")[0] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    by_day(
        [
            (
                ("--out", "x.csv"),
                r"--trial is missing, and there are several of two.toml: 1 drift of p, slope 0.5, from 43 s",
            ),
            (("--out", "x.csv", "--trial", 4), "there is no trial 4 of two.toml"),
            (("--out", "x.csv", "--trial", 0), "there is no trial 0 of two.toml"),
            (
                ("--out", "x.csv", "--trial", 3),
                "trial 3: half_width is '50 % of rms', and what it is a share of is only",
            ),
            (("--trial", 1), "--out is missing"),
            (("--out", "log.csv", "--trial", 1, "--force"), "which is read; give another name"),
            (("--out", "x.parquet", "--trial", 1), "its name ends in .csv"),
            (("--out", "there.csv", "--trial", 1), "there.csv exists"),
            (("--out", "x.csv", "--trial", 1, "--map", "p=gyro:rad/s"), "no column 'gyro'"),
            (("--out", "x.csv", "--trial", 1, "--attitude", "folows"), "did you mean 'follows'?"),
            (("--out", "x.csv", "--trial", 1, "--attitude", "follows:soon"), "'soon' is no time constant in seconds"),
            (("--out", "x.csv", "--trial", 1, "--attitude", "follows:-1"), "time_constant_s is -1.0"),
            (("--out", "x.csv", "--trial", 1, "--attitude", "own", "--time-constant-s", "2"), "has no time constant"),
        ],
        3,
    ),
)
def test_what_cant_be_meant_is_one_line_and_leaves_nothing_behind(cli, here, options, message):
    (here / "there.csv").write_text("mine")
    before = sorted((path.name, path.read_bytes()) for path in here.iterdir())
    code, out, err = cli("inject", "log.csv", "--fault", "two.toml", *options)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert sorted((path.name, path.read_bytes()) for path in here.iterdir()) == before


def test_the_list_shows_columns_and_trials_and_writes_nothing(cli, here):
    code, out, err = cli("inject", "log.csv", "--fault", "two.toml", "--list")
    assert (code, err) == (0, "")
    assert "p_deg_s" in out
    assert "trial 2 drift of q, slope 0.5, from 43 s + jam of r, from 50 s to 52 s" in out
    printed = json.loads(cli("inject", "log.csv", "--fault", "jam", "--list", "--json")[1])
    assert printed["trials"] == [f"jam of {channel}, from 300 s" for channel in "pqr"]
    assert "p" in {column["channel"] for column in printed["columns"]}
    assert len(list(here.iterdir())) == 2
