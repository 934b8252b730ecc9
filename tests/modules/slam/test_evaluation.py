from __future__ import annotations

import json
import re
import threading

import pytest
import zenoh

from modules.slam import estimates
from modules.slam.estimates import Estimate
from modules.slam.evaluation import main
from modules.slam.trajectory import save, trajectory
from tests.modules.robotkit.bus import Matching, client, router

SECOND = 1_000_000_000


def row(index, x, *, start=0):
    return start + index * SECOND // 10, (x, 0.1 * (index % 3), 0, 0, 0, 0, 1)


@pytest.fixture
def files(tmp_path):
    save(tmp_path / "truth.tum", trajectory(row(index, index / 10) for index in range(20)))
    save(tmp_path / "poses.tum", trajectory(row(index, index / 10 + 0.001 * index) for index in range(15, 30)))
    return tmp_path


def test_a_file_is_scored_where_there_is_ground_truth(files, capsys):
    assert main([str(files / "truth.tum"), str(files / "poses.tum"), "--output", "json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["poses"], report["compared"]) == (15, 5)
    assert report["end_drift"] == pytest.approx(0.004)
    assert report["rpe"]["metres"]["mean"] == pytest.approx(0.001)
    assert "cpu_ms" not in report


def test_the_figures_are_readable(files, capsys):
    assert main([str(files / "truth.tum"), str(files / "poses.tum"), "--unit", "metres", "--delta", "0.2"]) == 0
    wanted = capsys.readouterr().out
    assert "compared: 5\n" in wanted
    assert "ate.rmse: 0.00" in wanted
    assert "rpe.metres: rmse 0." in wanted


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (["truth.tum", "missing.tum"], r"missing\.tum: cannot be read"),
        (["missing", "poses.tum"], "missing: cannot be read"),
        (["truth.tum", "poses.tum", "--delta", "50"], "choose a smaller --delta"),
        (["late.tum", "poses.tum"], "0 of 15 poses are within 0.01 s"),
        (["truth.tum", "--live"], "ZENOH_CONNECT is empty"),
        (["truth.tum", "--run"], "no EuRoC sequence"),
    ],
)
def test_unusable_arguments_are_reported_in_one_line(files, capsys, monkeypatch, arguments, wanted):
    monkeypatch.delenv("ZENOH_CONNECT", raising=False)
    monkeypatch.chdir(files)
    save(files / "late.tum", trajectory(row(index, index, start=99 * SECOND) for index in range(20)))
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(wanted, line)


def message(**changes):
    whole = {"frame": 5, "position": [1, 2, 3], "orientation": [0, 0, 0, 1], "state": "tracking"}
    return json.dumps(whole | {"timing": {"dropped": 4, "cpu": 20_000_000}} | changes).encode()


def test_live_poses_are_collected_and_lost_ones_counted():
    heard = Estimate()
    for payload in (message(), message(state="lost"), message(state="adrift"), message(frame=4, state="degraded")):
        heard.hear(payload)
    assert heard.trajectory.stamps.tolist() == [4, 5]
    assert (heard.degraded, heard.lost, heard.adrift, heard.broken, heard.dropped) == (1, 1, 1, 0, 4)
    assert heard.cpu == [0.02] * 4


@pytest.mark.parametrize(
    "payload",
    [
        b"noise",
        b"\xff",
        b"[]",
        b"{}",
        message(position=[1, 2]),
        message(position=[1, 2, None]),
        message(position=[1, 2, "x"]),
        message(position=[1, 2, float("nan")]),
        message(orientation=[0, 0, 0, 0]),
        message(frame="x"),
        message(timing=[1]),
        message(state="asleep"),
    ],
)
def test_invalid_poses_are_counted(payload):
    heard = Estimate()
    heard.hear(payload)
    assert (heard.poses, heard.broken) == ([], 1)


def test_poses_are_heard_on_the_bus():
    with router() as address, client(address) as module, client(address) as ours:
        ended = threading.Event()
        publisher = module.declare_publisher("robot/slam/pose", congestion_control=zenoh.CongestionControl.BLOCK)
        listening = Matching(publisher)

        def speak():
            listening.wait(expected=True)
            for payload in (message(), b"noise", message(frame=6)):
                publisher.put(payload)
            module.put("done", b"", congestion_control=zenoh.CongestionControl.BLOCK)

        ours.declare_subscriber("done", lambda _: ended.set())
        speaker = threading.Thread(target=speak)
        speaker.start()
        heard = estimates.listen(ours, "robot/slam/pose", ended, 10)
        speaker.join()
    assert (heard.trajectory.stamps.tolist(), heard.broken) == ([5, 6], 1)


def test_a_sequence_is_run_and_saved(short, tmp_path, capsys):
    assert main([str(short), "--run", "--save", str(tmp_path / "poses.tum"), "--output", "json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["compared"], report["lost"], report["broken"]) == (50, 0, 0)
    assert report["ate"]["rmse"] < 0.02
    assert main([str(short / "mav0"), str(tmp_path / "poses.tum")]) == 0
    assert f"ate.rmse: {report['ate']['rmse']:.4g}\n" in capsys.readouterr().out
