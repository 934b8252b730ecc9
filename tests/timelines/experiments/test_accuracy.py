"""The accuracy of tasks in runs whose results are made up, against a known story."""

from __future__ import annotations

import pytest

from contextpolicy.streams.timeline import parse
from timelines.experiments.accuracy import Judge
from timelines.experiments.due import Schedule, Window
from timelines.experiments.raw_data import Result, RunData

BEGIN = 1_795_300_000.0
S = 1_000_000_000
POSES = "walk/mav0/state_groundtruth_estimate0"
INPUTS = [
    {"key": "robot/camera/stereo", "encoding": "binary", "from": 0, "to": 20, "dataset": "walk/stereo", "rate": 10,
     "truth": {"poses": POSES}},
    {"key": "robot/camera/side", "encoding": "binary", "from": 0, "to": 20, "dataset": "signs/walk", "rate": 2,
     "truth": {"signs": [{"from": 1, "to": 3, "text": "204"}, {"from": 9, "to": 11, "text": "206"}]}},
    {"key": "robot/microphone", "encoding": "binary", "from": 0, "to": 20, "dataset": "speech/walk", "rate": 10,
     "truth": [{"at": 2, "keyword": "left"}, {"at": 8, "keyword": "right"}, {"at": 16, "keyword": "stop"}]},
    {"key": "robot/imu/raw", "encoding": "json", "from": 0, "to": 20, "dataset": "walk/imu", "rate": 200,
     "truth": {"moving": [[5, 12]]}},
    {"key": "robot/navigation/order", "encoding": "json", "from": 5, "to": 12, "rate": 4,
     "value": {"drive": {"forward": 0.3, "turn": 0.0}}},
    {"key": "robot/navigation/order", "encoding": "json", "at": 12, "value": {"stop": True}},
    {"key": "robot/arm/order", "encoding": "json", "at": 3, "value": {"home": True}, "truth": {"doing": "arrived"}},
    {"key": "robot/arm/order", "encoding": "json", "at": 14, "value": {"home": True}, "truth": {"doing": "arrived"}},
]  # fmt: skip
PHASES = [{"name": "walks", "from": 0, "to": 20}]
TASKS = ("slam", "signs", "speech", "imu", "navigation", "arm")


@pytest.fixture
def judge(tmp_path):
    """Accuracies of a run whose tasks reported `results`: by key, (seconds of the run, message)."""
    story = parse({"name": "walk", "duration": 20.0, "phases": PHASES, "inputs": INPUTS})

    def judged(results, *windows):
        run = RunData(BEGIN)
        for key, reported in results.items():
            run.results[key] = [Result(BEGIN + at, BEGIN + at, value) for at, value in reported]
        schedule = Schedule(20.0, {}, {task: {} for task in TASKS}, {}, windows or [Window(0, 20, (), frozenset())])
        return Judge(story, schedule, tmp_path).accuracy(run)

    return judged


def test_an_arm_that_follows_is_judged_by_how_far_it_is_from_where_it_should_be(tmp_path):
    """When the next place comes; the last of an occasion has none."""
    orders = [
        {"key": "robot/arm/order", "encoding": "json", "at": at, "value": {"move": [x, 0.0, 50.0]},
         "truth": {"follows": True}} for at, x in ((1.0, 100), (1.25, 104), (1.5, 108), (9.0, 100))
    ]  # fmt: skip
    story = parse({"name": "follow", "duration": 20.0, "phases": PHASES, "inputs": orders})
    run = RunData(BEGIN)
    run.results["robot/arm/state"] = [
        Result(BEGIN + at, BEGIN + at, {"position": [x, 0.0, 50.0]}) for at, x in ((1.2, 100), (1.6, 108))
    ]
    windows = [Window(0, 8, ("grip",), frozenset()), Window(8, 20, ("drive",), frozenset())]
    found = Judge(story, Schedule(20.0, {}, {"arm": {}}, {}, windows), tmp_path).accuracy(run)["grip: arm"]
    assert found.value == pytest.approx(0.002)
    assert (found.unit, found.count) == ("m", 2)


def test_a_task_that_is_played_by_itself_is_judged_from_its_own_begin(tmp_path):
    """As where each task is alone: the microphone is played when the cameras have ended."""
    story = parse({"name": "walk", "duration": 20.0, "phases": PHASES, "inputs": INPUTS})
    run = RunData(BEGIN, starts={"robot/camera/stereo": BEGIN, "robot/microphone": BEGIN + 60})
    heard = {"keyword": "left", "at": BEGIN + 62.1}
    run.results["robot/speech/keyword"] = [Result(BEGIN + 63, BEGIN + 63, heard)]
    schedule = Schedule(20.0, {}, {"speech": {}}, {}, [Window(0, 20, (), frozenset())])
    assert Judge(story, schedule, tmp_path).accuracy(run)["speech"].value == pytest.approx(100 / 3)


def keywords(*reported):
    return {"robot/speech/keyword": [(at + 1, {"keyword": word, "at": BEGIN + at}) for at, word in reported]}


def test_commands_are_heard_by_their_word_and_time(judge):
    found = judge(keywords((2.1, "left"), (8.1, "left"), (19.8, "stop")))["speech"]
    assert (found.value, found.count) == (pytest.approx(100 / 3), 3)


def test_a_command_in_a_context_that_does_not_want_speech_is_not_due(judge):
    moving = Window(5, 12, ("moving",), frozenset({"speech"}))
    around = Window(0, 5, (), frozenset()), moving, Window(12, 20, (), frozenset())
    found = judge(keywords((2.1, "left"), (16.1, "stop")), *around)["speech"]
    assert (found.value, found.count) == (100, 2)


def test_a_critical_task_is_judged_in_its_own_contexts_as_well(judge):
    """Elsewhere others come first: what is not heard or read there is tabulated."""
    around = [
        Window(0, 7, ("drive",), frozenset()),
        Window(7, 12, ("read",), frozenset()),
        Window(12, 20, ("talk",), frozenset()),
    ]
    signs = {"robot/signs/number": [(9.5, {"text": "206"})]}
    found = judge({**keywords((2.1, "left"), (16.1, "stop")), **signs}, *around)
    assert {name: (one.value, one.count) for name, one in found.items() if ":" in name} == {
        "read: signs": (100, 1),
        "talk: speech": (100, 1),
    }
    assert (found["signs"].value, found["speech"].value) == (50, pytest.approx(200 / 3))


def test_a_sign_is_reported_while_it_is_in_view_or_soon_after(judge):
    reported = [(1.5, {"text": "204"}), (16.0, {"text": "206"})]
    assert judge({"robot/signs/number": reported})["signs"].value == 50


def test_motion_is_right_or_wrong_answer_by_answer(judge):
    reported = [
        (1, {"moving": False}),
        (6, {"moving": True}),
        (8, {"moving": False}),
        (13, {"moving": False}),
        (14, {}),
    ]
    found = judge({"robot/imu/motion": reported})["imu"]
    assert (found.value, found.count) == (75, 4)


def test_path_length_is_compared_with_the_order(judge):
    reported = [(0, {"travelled": 1.0}), (19, {"travelled": 3.0})]
    found = judge({"robot/navigation/odometry": reported})["navigation"]
    assert found.value == pytest.approx(0.1)  # 2 m of 0.3 m/s in 7 s
    assert not found.more_is_better


def test_an_order_must_finish_before_the_next(judge):
    reported = [(4, {"doing": "moving"}), (15, {"doing": "arrived"})]
    found = judge({"robot/arm/state": reported})["arm"]
    assert (found.value, found.count) == (50, 2)


def test_poses_are_compared_with_the_truth_of_their_frame(judge, tmp_path):
    folder = tmp_path / POSES
    (tmp_path / "walk" / "mav0" / "imu0").mkdir(parents=True)
    (tmp_path / "walk" / "mav0" / "imu0" / "data.csv").touch()  # what makes it a sequence
    folder.mkdir(parents=True)
    rows = [f"{frame * S},{frame * 0.1},{frame % 3},0,1,0,0,0,0,0,0,0,0,0,0,0,0\n" for frame in range(1, 21)]
    (folder / "data.csv").write_text("#timestamp, p\n" + "".join(rows), encoding="utf-8")
    poses = [
        (frame / 2, {"frame": frame * S, "position": [frame * 0.1 + 5, frame % 3, 1], "orientation": [0, 0, 0, 1],
                     "state": "lost" if frame > 18 else "tracking"})
        for frame in range(1, 21)
    ]  # fmt: skip
    found = judge({"robot/slam/pose": poses})["slam"]
    assert found.value == pytest.approx(0, abs=1e-6)  # moved as a whole, which is no error
    assert found.count == 18


def test_poses_of_no_moment_of_the_truth_are_not_judged(judge, tmp_path):
    folder = tmp_path / POSES
    (tmp_path / "walk" / "mav0" / "imu0").mkdir(parents=True)
    (tmp_path / "walk" / "mav0" / "imu0" / "data.csv").touch()
    folder.mkdir(parents=True)
    (folder / "data.csv").write_text(f"#timestamp, p\n{S},0,0,0,1,0,0,0,0,0,0,0,0,0,0,0\n", encoding="utf-8")
    pose = {"position": [0, 0, 1], "orientation": [0, 0, 0, 1], "state": "tracking"}
    poses = [(frame / 2, {"frame": (1000 + frame) * S, **pose}) for frame in range(20)]
    assert "slam" not in judge({"robot/slam/pose": poses})


def test_a_task_without_results_is_not_judged_unless_it_should_have_some(judge):
    found = judge({})
    assert sorted(found) == ["arm", "signs", "speech"]
    assert {one.value for one in found.values()} == {0}
