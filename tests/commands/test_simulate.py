from __future__ import annotations

import csv
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from contextpolicy.cli import main
from contextpolicy.streams.timeline import load
from timelines.recording.mcap_file import McapWriter

ROOT = Path(__file__).parents[2]
POLICY = str(ROOT / "config/policies/delivery-robot.yaml")
EXPECTED = str(ROOT / "config/expectations/delivery-robot.yaml")
DEMO = str(ROOT / "timelines/demo.json")
TWO_CORES = ("simulate", POLICY, DEMO, "--cores", "2")

TABLE = """\
  TIME  CONTEXTS  SLAM (WEIGHT)  SPEECH (WEIGHT)  CAUSE
 0.000  -         850m (1)       850m (1)         containers changed
 5.000  -         150m (1)       1550m (10)       mic: mic.level > 0.1 is 1
10.000  -         850m (10)      850m (10)        imu: norm(imu.gyro) > 0.02 is 1
10.100  moving    1690m (10)     10m (0)          imu: context moving entered
"""


def test_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TWO_CORES, "--until", "15"]) == 0
    assert capsys.readouterr().out == TABLE


NARROW = """\
10.100
  CONTEXTS         moving
  SLAM (WEIGHT)    1690m (10)
  SPEECH (WEIGHT)  10m (0)
  CAUSE            imu: context moving
                   entered
"""


def test_a_narrow_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    assert main([*TWO_CORES, "--until", "15"]) == 0
    out = capsys.readouterr().out
    assert out.endswith(NARROW)
    assert max(map(len, out.splitlines())) <= 40


def test_json_has_the_names_of_the_decision_bus(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TWO_CORES, "--until", "15", "--output", "json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["policy"] == "robot/delivery-robot"
    (last, *followed) = [plan for plan in document["plans"] if plan["sequence"] == 5]
    assert (last["time"], last["contexts"]) == (10.1, ["moving"])
    assert [(plan["time"], plan["tasks"]["speech"]["score"]) for plan in followed] == [(10.9, 0.1), (14.0, 1.0)]
    assert last["tasks"]["slam"]["share"] == 1.69
    assert last["nodes"]["robot"] == {
        "capacity": 1.7,
        "scheduler": "CFS",
        "dividedBy": "Weight",
        "tasks": {"slam": 1.69, "speech": 0.01},
    }


def test_csv_has_a_row_for_each_plan_and_task(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TWO_CORES, "--until", "15", "--output", "csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert len(rows) == 12
    assert rows[7] | {"cause": ""} == {
        "time": "10.1",
        "sequence": "5",
        "cause": "",
        "contexts": "moving",
        "task": "speech",
        "score": "1.0",
        "weight": "0.0",
        "share": "0.01",
        "suspended": "True",
    }


ROS2 = (str(ROOT / "config/policies/ros2.yaml"), str(ROOT / "timelines/ros2.json"))


def strictly(text: str) -> Any:
    """JSON as everybody reads it: without NaN and Infinity."""

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    return json.loads(text, parse_constant=refuse)


def test_infinite_lidar_ranges_are_valid_in_json_and_plot(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    picture = tmp_path / "plan.svg"
    assert main(["simulate", *ROS2, "--output", "json", "--plot", str(picture)]) == 0
    out, err = capsys.readouterr()
    contexts = [tuple(plan["contexts"]) for plan in strictly(out)["plans"]]
    assert list(dict.fromkeys(contexts)) == [(), ("driving",), ("driving", "company"), ("company",)]
    assert err == ""
    assert "nan" not in picture.read_text(encoding="utf-8").lower()
    assert main(["explain", ROS2[0], "--timeline", ROS2[1], "--at", "5", "--output", "json"]) == 0
    explained = strictly(capsys.readouterr().out)
    assert explained["streams"]["scan"]["value"]["ranges"] == ["Infinity", "Infinity", "NaN", "Infinity"]


@pytest.mark.parametrize("suffix", ["svg", "png"])
def test_plot(suffix: str, tmp_path: Path) -> None:
    picture = tmp_path / f"plan.{suffix}"
    assert main([*TWO_CORES, "--plot", str(picture)]) == 0
    content = picture.read_bytes()
    assert content.startswith(b"\x89PNG" if suffix == "png" else b"<?xml")
    if suffix == "svg":
        assert all(word in content for word in (b"slam", b"speech", b"moving", b"delivery-robot on demo"))


def test_the_same_run_draws_the_same_picture(tmp_path: Path) -> None:
    pictures = [tmp_path / "a.svg", tmp_path / "b.svg"]
    for picture in pictures:
        main([*TWO_CORES, "--plot", str(picture)])
    assert pictures[0].read_bytes() == pictures[1].read_bytes()


def test_missing_plot_folder_is_refused_before_simulating(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([*TWO_CORES, "--plot", str(tmp_path / "nowhere" / "shares.svg")])
    printed = capsys.readouterr()
    assert "expected a file in a folder that exists" in printed.err
    assert printed.out == ""


def test_plot_without_matplotlib_shows_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main([*TWO_CORES, "--plot", str(tmp_path / "plan.svg")]) == 2
    assert "pip install '.[plot]' in a checkout" in capsys.readouterr().err


def test_assert_as_expected(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TWO_CORES, "--assert", EXPECTED]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines()[-1] == f"{POLICY} on {DEMO}: 7 expectations, as expected"


def test_assert_prints_each_difference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    expected = tmp_path / "expect.yaml"
    expected.write_text("- {at: 12, shares: {slam: 1}}\n- {at: 99, contexts: []}\n")
    assert main([*TWO_CORES, "--assert", str(expected)]) == 1
    assert [line for line in capsys.readouterr().err.splitlines() if not line.startswith("note:")] == [
        f"{expected}: line 2: expectation at 99 s, but the run ends at 30 s",
        f"{expected}: line 1, at 12 s: share of slam: expected 1000m, but 1690m",
        "    plan 5 of 10.100 s, caused by imu: context moving entered",
        f"{POLICY} on {DEMO}: 2 expectations, 2 differences",
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("simulate", "nowhere.yaml", DEMO), "nowhere.yaml: cannot read file: No such file or directory\n"),
        (("simulate", POLICY, "nowhere.json"), "nowhere.json:\n  cannot read file: No such file or directory\n"),
        (("simulate", DEMO, DEMO), f"{DEMO}: no ContextPolicy found\n"),
        (("simulate", POLICY, POLICY), f"{POLICY}:\n  not valid JSON: Expecting value: line 1 column 1 (char 0)\n"),
        (
            ("simulate", POLICY, DEMO, "--assert", "nowhere.yaml"),
            "nowhere.yaml:\n  cannot read file: No such file or directory\n",
        ),
        (("simulate", POLICY, DEMO, "--assert", POLICY), "a list of expectations"),
        (("simulate", str(ROOT / "tests/e2e/bad_policies/mode-misspelt.yaml"), DEMO), "one of Enforce, DryRun, Paused"),
    ],
)
def test_invalid_file_exits_2(arguments: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(list(arguments)) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("wrong", [("--cores", "0"), ("--until", "-1"), ("--plot", "x.gif"), ("--output", "xml")])
def test_wrong_usage(wrong: tuple[str, str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main([*TWO_CORES, *wrong])
    assert caught.value.code == 2


def run(*arguments: str, stdin: str = "") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "contextpolicy", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "operator")}
    return subprocess.run(command, input=stdin, capture_output=True, text=True, env=environment, check=False)


def test_each_file_may_come_from_standard_input() -> None:
    assert run("simulate", "-", DEMO, "--until", "5", stdin=Path(POLICY).read_text()).stdout.lstrip().startswith("TIME")
    assert run("simulate", POLICY, "-", "--until", "5", stdin=Path(DEMO).read_text()).stdout.lstrip().startswith("TIME")
    assert run(*TWO_CORES, "--assert", "-", stdin=Path(EXPECTED).read_text()).returncode == 0


def test_standard_input_is_read_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "-", "-"]) == 2
    assert "timeline: invalid value '-': expected a file, as only one input can be stdin" in capsys.readouterr().err


def test_a_closed_output_pipe_prints_no_traceback() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "contextpolicy", *TWO_CORES]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "operator")}
    done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, env=environment, check=False)
    os.close(writing)
    assert done.returncode == 128 + 13, "as shells report SIGPIPE"
    assert b"BrokenPipe" not in done.stderr


def test_until_zero_shows_the_first_plan(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TWO_CORES, "--until", "0"]) == 0
    (row,) = capsys.readouterr().out.splitlines()[1:]
    assert row.split() == TABLE.splitlines()[1].split()


def test_several_nodes_replicas_and_requests(capsys: pytest.CaptureFixture[str]) -> None:
    robot = ("--node", "head=2", "--node", "arm=500m", "--place", "speech=arm", "--place", "speech=head")
    assert main(["simulate", POLICY, DEMO, *robot, "--request", "speech=100m", "--output", "json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["cores"] == 2.5
    moving = next(plan for plan in document["plans"] if plan["contexts"] == ["moving"])
    assert {name: node["tasks"] for name, node in moving["nodes"].items() if name == "head"} == {
        "head": {"slam": 1.69, "speech": 0.01}
    }


def test_notes_are_in_the_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TWO_CORES, "--output", "json"]) == 0
    assert "no stream reads robot/camera/stereo" in json.loads(capsys.readouterr().out)["notes"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--place", "slamm=robot"), "invalid value 'slamm': expected one of slam, speech; did you mean slam?"),
        (("--place", "slam=arm"), "--place: invalid value 'arm': expected one of robot"),
        (("--replicas", "imu=2"), "--replicas: invalid value 'imu': expected one of slam, speech"),
        (("--request", "imu=2"), "--request: invalid value 'imu': expected one of slam, speech"),
        (("--no-realtime", "arm"), "--no-realtime: invalid value 'arm': expected one of robot"),
        (("--node", "arm=1"), "--cores: invalid value 2000: expected either --cores or --node, not both"),
    ],
)
def test_an_invalid_robot(options: tuple[str, str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TWO_CORES, *options]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "allowed"),
    [
        (("--until", "1e9"), "a number of seconds from 0 to 10000000"),
        (("--until", "soon"), "a number of seconds from 0 to 10000000"),
        (("--cores", "2000"), "above 0 and at most 1024"),
        (("--rate", "0"), "a factor from 0.001 to 1000"),
        (("--cores", "0.0001"), "a CPU quantity"),
        (("--node", "arm"), "NAME=VALUE"),
        (("--replicas", "slam=0"), "an integer from 1 to 100"),
    ],
)
def test_wrong_usage_says_what_is_allowed(
    option: tuple[str, str], allowed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([*TWO_CORES, *option])
    assert allowed in capsys.readouterr().err


def realtime(tmp_path: Path, fallback: str = "CFS") -> str:
    enforcement = f"enforcement:\n    scheduler: Realtime\n    realtimeFallback: {fallback}"
    path = tmp_path / "realtime.yaml"
    path.write_text(Path(POLICY).read_text().replace("reserve: 300m", f"{enforcement}\n  reserve: 0"))
    return str(path)


def test_realtime_shares_are_cores_in_every_output(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two tasks of equal weight have 95 % of four processors."""
    reported = {}
    for output in ("table", "csv", "json"):
        assert main(["simulate", realtime(tmp_path), DEMO, "--until", "1", "--output", output]) == 0
        reported[output] = capsys.readouterr().out
    assert "  1900m (1)      1900m (1)" in reported["table"]
    assert [row.split(",")[7] for row in reported["csv"].splitlines()[1:3]] == ["1.9", "1.9"]
    [first, *_] = json.loads(reported["json"])["plans"]
    assert [task["share"] for task in first["tasks"].values()] == [1.9, 1.9]
    assert {name: node["capacity"] for name, node in first["nodes"].items()} == {"robot": 3.8}


def test_a_robot_without_realtime_falls_back_as_the_policy_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", realtime(tmp_path), DEMO, "--until", "1", "--no-realtime"]) == 0
    assert "  2000m (1)      2000m (1)" in capsys.readouterr().out
    assert main(["simulate", realtime(tmp_path, "None"), DEMO, "--until", "1", "--no-realtime", "robot"]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines() == ["TIME  CONTEXTS  CAUSE"]
    assert "note: node robot can't do realtime and is left alone" in err


@pytest.mark.parametrize("nested", ['{"name": ' * 100_000, "[" * 100_000])
def test_a_timeline_that_nests_deeply_is_refused(
    nested: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "deep.json"
    path.write_text(nested)
    assert main(["simulate", POLICY, str(path)]) == 2
    assert "not valid JSON: nested too deeply" in capsys.readouterr().err


def test_the_help_names_every_field_of_the_output(capsys: pytest.CaptureFixture[str]) -> None:
    main([*TWO_CORES, "--output", "json"])
    document = json.loads(capsys.readouterr().out)
    main([*TWO_CORES, "--output", "csv"])
    columns = capsys.readouterr().out.splitlines()[0].split(",")
    with pytest.raises(SystemExit):
        main(["simulate", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    (plan, *_), names = document["plans"], {*document, *columns}
    names |= {*plan, *plan["tasks"]["slam"], *plan["nodes"]["robot"], "message"}
    assert [name for name in names if not re.search(rf"\b{name}\b", text)] == []
    assert "2000-01-01 00:00 UTC" in text


@pytest.mark.parametrize("tty", [True, False])
def test_progress_is_shown_on_a_terminal_only(
    tty, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: tty)
    main(list(TWO_CORES))
    out, err = capsys.readouterr()
    assert ("simulating" in err) is tty
    assert "simulating" not in out


def test_a_robots_recording_gives_the_plans_that_its_timeline_gives(tmp_path, capsys):
    recording = tmp_path / "run.mcap"
    inputs = load(DEMO).inputs()
    with McapWriter(recording) as file:
        for timed in inputs:
            if timed.value is not None:
                assert isinstance(timed.value, dict)
                at = 1_795_300_000_000_000_000 + round(timed.at * 1e9)
                payload = json.dumps({"stamp": at, **timed.value}).encode()
                file.heard(timed.key, "json", payload, received=at, stamp=at)
    assert main(["simulate", POLICY, str(DEMO), "--output", "csv", "--until", "29"]) == 0
    expected = capsys.readouterr().out
    assert main(["simulate", POLICY, str(recording), "--output", "csv", "--until", "29"]) == 0
    assert capsys.readouterr().out == expected
    assert main(["simulate", POLICY, str(recording), "--start-offset", "99"]) == 2
    assert "start offset: invalid value 99: expected at most" in capsys.readouterr().err


def test_a_damaged_recording_is_refused_or_read_partially(tmp_path, capsys):
    recording = tmp_path / "run.mcap"
    with McapWriter(recording) as file:
        for index in range(300):
            at = 1_795_300_000_000_000_000 + index * 10**8
            payload = json.dumps({"stamp": at, "speed": 0.5, "noise": hash(str(index))}).encode()
            file.heard("robot/imu", "json", payload, received=at, stamp=at)
    recording.write_bytes(recording.read_bytes()[:-200])
    assert main(["simulate", POLICY, str(recording)]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert re.search(r"run\.mcap .*messages were read, over \d+\.\d+ s; `mcap recover`.*--skip-damaged", line)
    assert main(["simulate", POLICY, str(recording), "--skip-damaged", "--output", "json"]) == 0
    printed = capsys.readouterr()
    (note,) = [note for note in json.loads(printed.out)["notes"] if "left out" in note]
    assert f"note: {note}" in printed.err


def test_a_bag_without_metadata_and_a_bare_database_are_recordings(tmp_path, capsys):
    (tmp_path / "bag").mkdir()
    assert main(["simulate", POLICY, str(tmp_path / "bag")]) == 2
    assert "is a folder without metadata.yaml, and no storage file" in capsys.readouterr().err
    (tmp_path / "run.db3").write_bytes(b"SQLite format 3")
    assert main(["simulate", POLICY, str(tmp_path / "run.db3")]) == 2
    assert "`sqlite3 FILE .recover" in capsys.readouterr().err


def test_rate_scales_the_time_of_the_timeline(capsys):
    assert main([*TWO_CORES, "--until", "7.5", "--rate", "2", "--output", "json"]) == 0
    moving = next(plan for plan in json.loads(capsys.readouterr().out)["plans"] if plan["sequence"] == 5)
    assert (moving["time"], moving["contexts"]) == (5.1, ["moving"])  # 10 s in the file, and 0.1 s of `enterAfter`


def test_the_options_of_recordings_are_refused_with_a_timeline(capsys):
    assert main(["simulate", POLICY, str(DEMO), "--use-sim-time", "--skip-damaged", "--topics", "robot/imu"]) == 2
    assert capsys.readouterr().err.count("no value, as TIMELINE is not a recording") == 3
    with pytest.raises(SystemExit):
        main(["simulate", POLICY, "run.mcap", "--topics", "robot/b*"])
    assert "a topic or a key expression" in capsys.readouterr().err


@pytest.fixture
def profiles(tmp_path):
    own = {"key": "robot/imu", "depth": 1, "cpu": {"quantiles": [0.05]}}
    path = tmp_path / "profiles.json"
    path.write_text(json.dumps({"tasks": {"slam": {"deadline": 0.1, "inputs": {"imu": own}}}}), encoding="utf-8")
    return str(path)


def test_misses_are_predicted_and_can_be_expected(profiles, tmp_path, capsys):
    expected = tmp_path / "expected.yaml"
    expected.write_text("- {from: 0, to: 5, misses: {slam: {max: 0.01}}}\n", encoding="utf-8")
    assert main([*TWO_CORES, "--assert", str(expected)]) == 2
    assert "line 1 of" in capsys.readouterr().err
    assert main([*TWO_CORES, "--assert", str(expected), "--profiles", profiles]) == 1
    assert "misses of slam: expected at most 0.01, but" in capsys.readouterr().err


def test_the_prediction_follows_the_plans(profiles, capsys):
    assert main([*TWO_CORES, "--profiles", profiles]) == 0
    printed = capsys.readouterr()
    assert "\nTASK  CONTEXT  INPUTS" in printed.out
    assert "there is no profile for speech" in printed.err
    assert main([*TWO_CORES, "--profiles", profiles, "--output", "json"]) == 0
    forecast = json.loads(capsys.readouterr().out)["forecast"]
    assert forecast["tasks"]["slam"]["contexts"]["all"]["inputs"] == 1500
