"""A question's own words, looked up among the names of folders and files alone, lead to the file that answers it.

The questions stood in a table of fifty rows in docs/explanation/design.md, which nobody has to read any more.
"""

import ast
import re
from functools import cache
from math import log
from pathlib import Path

import pytest

import gtmbench

HOUSE = Path(gtmbench.__file__).parent
AMONG = 10  # files that a reader looks at
UNASKED = re.findall(
    r"\w+",
    "a an the of is are was be by in on at to it that which what with and or for not no any from its this "
    "beside before after whose who how than them over isn can there anybody",
)
ROOTS = {"written": "write", "flown": "fly", "made": "make", "known": "know", "broken": "break"}
ANSWERS = {
    "a sensor flown without": "detectors/accommodation/without_sensor.py",
    "an alarm raised": "detectors/monitor/alarms.py",
    "an open fault looked at again": "detectors/monitor/open_fault_review.py",
    "a fault's end found": "detectors/isolation/ended.py",
    "an aircraft stepped": "bench/stepping.py",
    "a surface broken": "bench/breaking.py",
    "a surface named": "detectors/surfaces/evidence.py",
    "a sensor read while flying": "bench/sensor_readings.py",
    "an engine brought to its steady state": "bench/engine.py",
    "an attitude made of the gyros": "values/attitude_estimators.py",
    "r or psi settled by a magnetometer": "method/magnetometer_witness.py",
    "a magnetometer, GPS, airspeed, accelerometer or altitude named": "engine/course/relations/",
    "a fault hypothesis": "detectors/isolation/hypotheses.py",
    "a sensor's own noise known": "detectors/isolation/own_noise.py",
    "bank auto composed": "detectors/bank/composed.py",
    "a fault tried on a record without watching it anew": "detectors/tried_faults.py",
    "a log watched": "log/watch.py",
    "the verdict on a log decided": "verdict/verdict.py",
    "the timeline of a log laid out": "log/judging/timeline.py",
    "a sensor cleared, and up to which size": "engine/hindsight/cleared_sensors.py",
    "a burst in which gyro and attitude part": "engine/bursts.py",
    "the part judged that a monitor was learnt from": "log/judging/learnt_part.py",
    "an error found that is there from power-on, or told what to fly next": "history/next_motion.py",
    "an IMU judged that isn't watched": "engine/imus/",
    "a link's closing word decided": "link/closing.py",
    "a contact with the ground told, or a crash": "log/learning/crashes.py",
    "a log without a heading watched": "log/opening/without_heading.py",
    "a log refused": "log/self_check/refusal.py",
    "a certificate computed": "log/judging/certificate.py",
    "decided whether the gyros drive an attitude": "method/driven_attitude.py",
    "a fault put through an estimator": "values/attitude_estimators.py",
    "an open column found out": "intake/open_columns.py",
    "known what a source's columns are, or the words in anybody's": "intake/formats/source_columns.toml",
    "a folder of tables taken for one log": "intake/formats/table_folder.py",
    "stated what of a log isn't read, and why": "intake/unread.py",
    "stated what a detector assumes beyond its channels": "detectors/assumptions.py",
    "a benchmark's row judged": "study/benchmark/judge.py",
    "the reference of detection": "study/reference.py",
    "a result written": "files/writing.py",
    "a published flight's failure known": "intake/published_failures.py",
    "a log's samples taken": "intake/fresh_samples.py",
    "a long log watched in pieces": "values/pieces.py",
    "a log read row by row, on a monitor's clock": "intake/row_by_row.py",
    "a link watched": "link/watched_link.py",
}
# by their field's own term, which the question doesn't use: registry, diagnosis, sensor chain, engine
BY_ANOTHER_WORD = {
    "a file named that can't be read": "intake/formats/registry.py",
    "a sensor named": "detectors/isolation/diagnosis.py",
    "a reading late, slow or rounded": "bench/sensor_chain.py",
    "a gyro named by the whole log": "engine/judged.py",
    "decided what must be a fault in a log": "detectors/isolation/diagnosis.py",
}


@pytest.fixture(scope="module")
def stem():
    stemmer = pytest.importorskip("snowballstemmer", reason="it comes with sphinx").stemmer("english")
    return lambda word: stemmer.stemWord(ROOTS.get(word.lower(), word.lower()))


@pytest.fixture(scope="module")
def house(stem):
    """Return the words of every file's path, those of its name apart."""
    files = [path.relative_to(HOUSE) for path in HOUSE.rglob("*") if path.suffix in {".py", ".toml", ".c"}]
    return {
        path.as_posix(): (
            [stem(word) for word in words(path.with_suffix(""))],
            [stem(word) for word in words(path.stem)],
        )
        for path in files
    }


def words(text):
    return re.findall(r"[A-Za-z]+", str(text))


def says(word, names):
    return any(
        word == name or (len(word) > 3 and word in name) or (len(name) > 4 and word.startswith(name)) for name in names
    )


def found(question, house, stem):
    """Return files, the best first: rare words count more, and those of a file's own name half as much again."""
    asked = {stem(word) for word in words(question) if word.lower() not in UNASKED}
    seen = {word: sum(says(word, path) for path, _ in house.values()) for word in asked}
    rare = {word: log(len(house) / count) if count else 0.0 for word, count in seen.items()}

    def score(file):
        path, name = house[file]
        hits = sum(rare[word] * (1.0 + 0.5 * says(word, name)) for word in asked if says(word, path))
        return -(hits - 0.05 * len(path)), file

    return sorted(house, key=score)


def test_a_questions_words_lead_to_its_file(house, stem):
    for question, answer in ANSWERS.items():
        first = found(question, house, stem)[:AMONG]
        assert any(file.startswith(answer) for file in first), f"{question}? {answer} isn't among {first}"


def test_the_files_of_other_questions_exist(house):
    assert set(BY_ANOTHER_WORD.values()) <= house.keys()


@cache
def functions_in(place):
    """Return the lines of the functions of a file, or of a folder's files, by name."""
    found = {}
    for file in sorted((HOUSE / place).glob("*.py")) or [HOUSE / place]:
        text = file.read_text().splitlines()
        for node in ast.walk(ast.parse("\n".join(text))):
            if isinstance(node, ast.FunctionDef):
                found.setdefault(node.name, []).extend(text[node.lineno - 1 : node.end_lineno])
    return found


def test_functions_that_are_hard_to_read_are_narrated():
    """Those that docs/explanation/design.md lists are there, and comments follow their steps."""
    page = (HOUSE.parent / "docs/explanation/design.md").read_text().partition("## Where a reader stops")[2]
    rows = [re.findall(r"`([\w/.]+)`", row) for row in page.splitlines() if row.startswith("| `")]
    listed = [(name, row) for row in rows for name in row if "/" not in name and "." not in name]
    assert len(listed) == 40
    for name, row in listed:
        told = [line for place in row if "/" in place for line in functions_in(place).get(name, [])]
        assert any(line.strip().startswith("# ") for line in told), name
