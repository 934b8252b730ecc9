"""Blocks are run, kept as they end, and gone on with; without a node."""

from __future__ import annotations

import json
import lzma
import pathlib
import shutil
import subprocess
from dataclasses import replace

import pytest

from tests.timelines.experiments.made_up import ABOUT, MEASURED, SCHEDULE, a_run
from timelines.demo import deploy
from timelines.demo.deploy import DeployError
from timelines.experiments import __main__ as command
from timelines.experiments import campaign, exclusive, installation, prepare
from timelines.experiments.blocks import HEAVY, LIGHT, START, trials
from timelines.experiments.calibration import demand
from timelines.experiments.campaign import Campaign
from timelines.experiments.capacity import Capacity
from timelines.experiments.configurations import LINUX, WEIGHTS
from timelines.experiments.evidence import Evidence, note_absent, read_frozen, read_search, write_frozen, write_schedule
from timelines.experiments.halving import score
from timelines.experiments.machine import ENOUGH
from timelines.experiments.metrics import Run
from timelines.experiments.prepare import LIGHTER, OutOfTimeError, Preparation, settings, tuned_weights
from timelines.experiments.record import RecordError, block, packed, records
from timelines.experiments.stories import HELD_OUT
from timelines.experiments.workbench import Folders, Setting, Workbench

CHOSEN = list(trials(stories=["library"], loads=[HEAVY], only=[LINUX.name, WEIGHTS.name], most=2))


@pytest.fixture(autouse=True)
def own_lock(monkeypatch, tmp_path):
    """A measurement that runs on this machine is not waited for."""
    monkeypatch.setattr(exclusive, "LOCK", tmp_path / "lock")


class Bench(Workbench):
    """Runs nothing: after `lasts` runs the node is gone, and the configuration `fails` never works."""

    def __init__(self, folder, lasts=99, fails=""):
        super().__init__(Folders(folder / "raw", folder / "data", folder, folder))
        self.done: list[tuple[str, int, float, dict[str, int]]] = []
        self.lasts, self.fails = lasts, fails

    def schedule(self, story, deadlines):
        del story, deadlines
        return SCHEDULE

    def _do(self, place, trial, setting, weights):
        if len(self.done) == self.lasts:
            raise DeployError("the node is gone")
        if trial.configuration.name == self.fails:
            raise DeployError("helm: timed\nout")
        self.done.append((trial.name, trial.block, setting.capacity.part, dict(weights)))
        record = a_run(trial.configuration.name, block=trial.block)
        file = self._file(place, trial)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(packed(record.as_json()))


class Lines:
    """What was reported."""

    def __init__(self):
        self.said: list[str] = []

    def say(self, line):
        self.said.append(line)


def run(bench, *, until=lambda _: True, chosen=CHOSEN):
    lines = Lines()
    made = Campaign(
        bench, {HEAVY: Setting(Capacity(1, 0.4), {})}, {HEAVY: {False: {"slam": 2}, True: {"slam": 3}}}, lines
    )
    return made.run(chosen, until=until, commit=False), lines.said


def test_a_block_is_kept_once_all_of_its_runs_are_done(tmp_path):
    left, _ = run(Bench(tmp_path), until=_three_times())
    assert left == 1
    [block] = (tmp_path / "data" / "blocks").iterdir()
    assert block.name == "2-heavy-01.json.xz"
    again = Bench(tmp_path)
    left, said = run(again)
    assert left == 0
    assert len(again.done) == 1
    assert said[0].startswith("[1/1, ")
    found = Evidence.read(tmp_path / "data")
    assert {name: sorted(blocks) for (_, _, name), blocks in found.runs.items()} == {"linux": [0, 1], "weights": [0, 1]}


def _three_times():
    left = iter((True, True, True))
    return lambda _: next(left, False)


def test_a_configuration_that_fails_is_left_out_and_the_others_are_kept(tmp_path):
    bench = Bench(tmp_path, fails=WEIGHTS.name)
    left, said = run(bench)
    assert left == 2
    assert [line for line in said if line.startswith("not run")] == [
        "not run: context weights, heavy load: helm: timed\nout"
    ]
    found = Evidence.read(tmp_path / "data")
    assert {name: sorted(blocks) for (_, _, name), blocks in found.runs.items()} == {"linux": [0, 1]}
    assert sorted((one.configuration, one.block, one.reason) for one in found.absent) == [
        ("weights", 0, "helm: timed out"),
        ("weights", 1, "helm: timed out"),
    ]


def test_what_was_left_out_joins_its_block_once_it_is_done(tmp_path):
    run(Bench(tmp_path, fails=WEIGHTS.name))
    assert run(Bench(tmp_path))[0] == 0
    found = Evidence.read(tmp_path / "data")
    assert {name: sorted(blocks) for (_, _, name), blocks in found.runs.items()} == {"linux": [0, 1], "weights": [0, 1]}
    assert found.absent == []


def test_a_node_on_which_everything_fails_ends_the_runs(tmp_path):
    with pytest.raises(DeployError):
        run(Bench(tmp_path, lasts=0))
    assert {one.reason for one in Evidence.read(tmp_path / "data").absent} == {"the node is gone"}


def test_each_run_has_its_loads_part_and_its_gatings_weights(tmp_path):
    bench = Bench(tmp_path)
    run(bench)
    assert {(part, weights["slam"]) for _, _, part, weights in bench.done} == {(0.4, 2)}


def test_a_run_under_another_load_is_not_taken_for_one_of_this(tmp_path):
    run(Bench(tmp_path))
    bench = Bench(tmp_path)
    with pytest.raises(DeployError, match=r"on 1 x 0\.4, not 1 x 0\.5: delete it"):
        bench.record(CHOSEN[0].group, CHOSEN[0], Setting(Capacity(1, 0.5), {}), {})


def test_nothing_is_begun_that_would_end_too_late(tmp_path):
    bench = Bench(tmp_path)
    left, _ = run(bench, until=lambda _: len(bench.done) < 3)
    assert left == 1
    assert len(bench.done) == 3


def test_a_block_is_begun_only_where_all_of_it_will_end_in_time(tmp_path):
    asked: list[float] = []

    def until(seconds):
        asked.append(round(seconds))
        return True

    run(Bench(tmp_path), until=until)
    one = 60 + round(START)
    assert asked == [one, one, 2 * one, one]  # whatever is left of a call is enough for its first run
    bench = Bench(tmp_path / "short")
    left, _ = run(bench, until=lambda seconds: seconds < 2 * one)
    assert left == 2
    assert {block for _, block, *_ in bench.done} == {0}


def test_a_block_whose_file_was_lost_is_written_again(tmp_path):
    run(Bench(tmp_path))
    [first, second] = sorted((tmp_path / "data" / "blocks").iterdir())
    before = second.read_bytes()
    second.unlink()
    again = Bench(tmp_path)
    run(again)
    assert again.done == []
    assert second.read_bytes() == before
    assert first.exists()


def test_a_run_that_is_kept_is_not_repeated_where_its_recording_is_gone(tmp_path):
    run(Bench(tmp_path))
    before = {path: path.read_bytes() for path in (tmp_path / "data" / "blocks").iterdir()}
    shutil.rmtree(tmp_path / "raw")
    again = Bench(tmp_path)
    left, said = run(again)
    assert left == 0
    assert said == [f"all runs are done: delete {tmp_path / 'raw'} and {tmp_path / 'data'} to start over"]
    assert again.done == []
    assert {path: path.read_bytes() for path in before} == before


def test_a_block_is_read_once_to_see_what_is_done(monkeypatch, tmp_path):
    run(Bench(tmp_path))
    shutil.rmtree(tmp_path / "raw")
    read: list[int] = []

    def counted(data):
        read.append(len(data))
        return records(data)

    monkeypatch.setattr(campaign, "records", counted)
    run(Bench(tmp_path))
    assert len(read) == 2  # blocks, of which each has two runs


def test_attempts_that_do_not_count_are_kept_with_their_block(monkeypatch, tmp_path):
    attempt = replace(a_run("linux"), about={**ABOUT, "failures": ["the player was late"]})
    monkeypatch.setattr(Bench, "rejected", lambda _, __, trial: [attempt] if trial.block == 0 else [])
    run(Bench(tmp_path))
    assert Evidence.read(tmp_path / "data").rejected == [attempt]
    monkeypatch.setattr(Bench, "rejected", lambda *_: [])
    (tmp_path / "data" / "blocks" / "2-heavy-01.json.xz").unlink()
    run(Bench(tmp_path))  # of which the recordings are gone
    assert Evidence.read(tmp_path / "data").rejected == [attempt]


def test_attempts_at_what_is_given_up_are_kept_too(monkeypatch, tmp_path):
    """Ten attempts that do not count are why it is given up: a reader has to be able to see them."""
    attempt = replace(a_run("weights"), about={**ABOUT, "failures": ["the same inputs took 83% of other runs' work"]})
    given = {WEIGHTS.name: [attempt]}
    monkeypatch.setattr(Bench, "rejected", lambda _, __, trial: given.get(trial.configuration.name, []))
    run(Bench(tmp_path, fails=WEIGHTS.name))
    assert Evidence.read(tmp_path / "data").rejected == [attempt]


def test_lighter_loads_have_static_weights_of_their_own():
    """What was searched where tasks want more is known to be worse there than what was found before."""
    assert tuned_weights({})[HEAVY] == tuned_weights({})[LIGHT]
    found = {"ungated": {"slam": 1}, "gated": {"slam": 2}, "ungated-at-1.26": {"slam": 3}}
    tuned = tuned_weights({"tuned": {name: {"weights": weights} for name, weights in found.items()}})
    assert tuned[HEAVY] == tuned["1.6"] == {False: {"slam": 1}, True: {"slam": 2}}
    assert tuned[LIGHT] == tuned["1.1"] == tuned["1.25"] == {False: {"slam": 3}, True: {"slam": 2}}


def test_static_weights_at_lighter_loads_are_the_best_of_their_search():
    """Computed again from its committed runs."""
    tried: dict[tuple[tuple[str, int], ...], list[Run]] = {}
    for one in read_search(command.DATA, LIGHTER):
        tried.setdefault(tuple(sorted(one.record.about["weights"].items())), []).append(one)
    best = max(tried, key=lambda weights: (len(tried[weights]), score(tried[weights])))
    assert dict(best) == read_frozen(command.DATA)["tuned"][LIGHTER]["weights"]


def test_a_configuration_that_comes_later_joins_its_block(tmp_path):
    bench = Bench(tmp_path)
    run(bench, chosen=[trial for trial in CHOSEN if trial.configuration is LINUX])
    shutil.rmtree(tmp_path / "raw")
    run(bench)
    assert [name for name, *_ in bench.done[2:]] == ["library-weights"] * 2
    found = Evidence.read(tmp_path / "data")
    assert {name: sorted(blocks) for (_, _, name), blocks in found.runs.items()} == {"linux": [0, 1], "weights": [0, 1]}


def test_what_is_due_may_not_change_between_runs(tmp_path):
    write_schedule(tmp_path, "library", SCHEDULE)
    write_schedule(tmp_path, "library", SCHEDULE)
    with pytest.raises(RecordError, match="has changed"):
        write_schedule(tmp_path, "library", replace(SCHEDULE, deadlines={}))


def test_what_is_due_is_compared_by_what_it_says(tmp_path):
    write_schedule(tmp_path, "library", SCHEDULE)
    path = tmp_path / "schedules" / "library.json.xz"
    path.write_bytes(lzma.compress(lzma.decompress(path.read_bytes()), preset=0))  # as another version of xz would
    write_schedule(tmp_path, "library", SCHEDULE)


def test_a_story_that_has_changed_is_found_out_before_anything_is_run(tmp_path):
    write_schedule(tmp_path / "data", "library", replace(SCHEDULE, deadlines={"slam": 9.0}))
    bench = Bench(tmp_path)
    with pytest.raises(RecordError, match="has changed"):
        run(bench)
    assert bench.done == []


def test_what_is_interrupted_while_it_is_written_leaves_what_was_there(monkeypatch, tmp_path):
    write_frozen(tmp_path, {"solo": {}})
    write_schedule(tmp_path, "library", SCHEDULE)
    note_absent(tmp_path, [CHOSEN[0].cell], "it can't")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(pathlib.Path, "replace", interrupt)
    for write in (
        lambda: write_frozen(tmp_path, {}),
        lambda: note_absent(tmp_path, [CHOSEN[1].cell], "it can't either"),
        lambda: write_schedule(tmp_path, "hotel", SCHEDULE),
    ):
        with pytest.raises(KeyboardInterrupt):
            write()
    assert {path: path.read_bytes() for path in before} == before
    assert Evidence.read(tmp_path).schedules.keys() == {"library"}


def test_what_was_calibrated_is_kept_for_people_to_read(tmp_path):
    assert read_frozen(tmp_path) == {}
    write_frozen(tmp_path, {"loads": {"heavy": Capacity(1, 0.4)}})
    assert read_frozen(tmp_path) == {"loads": {"heavy": [1, 0.4]}}
    assert json.loads((tmp_path / "frozen.json").read_text(encoding="utf-8"))


class Anywhere(Bench):
    """Runs nothing, under whatever load is wanted."""

    def _do(self, place, trial, setting, weights):
        super()._do(place, trial, setting, weights)
        record = a_run(trial.configuration.name, story=trial.story.name, block=trial.block)
        kept = replace(record, about={**record.about, "capacity": list(setting.capacity)})
        self._file(place, trial).write_bytes(packed(kept.as_json()))


def test_loads_and_deadlines_follow_from_each_task_alone(monkeypatch, tmp_path):
    """SLAM wants 0.15 of a core and speech 0.025; while it drives SLAM wants 0.15 of them."""
    monkeypatch.setattr(prepare, "own_deadlines", lambda: {"slam": 0.1, "speech": 1.0})
    monkeypatch.setattr(installation, "cores", lambda: 2)
    lines = Lines()
    found = Preparation(Anywhere(tmp_path), lines, lambda _: True).calibrated()
    assert found["wanted"] == pytest.approx({"slam": 0.15, "speech": 0.025})
    assert found["needs"]["drive"] == pytest.approx(0.15)
    assert found["loads"] == {"light": (1, 0.25), "heavy": (1, 0.176), "paper": (1, 0.176)}  # 0.15 is 85 % of it
    assert found["asked"] == {"light": 0.7, "heavy": 0.99, "paper": 0.99}
    assert (found["deadlines"], found["solo"]) == ({"slam": 0.1, "speech": 1.0}, {"slam": 1.0, "speech": 1.0})
    assert "wanted by critical and protected tasks: drive 0.15 processors, talk 0.025 processors" in lines.said
    write_frozen(tmp_path, found)
    assert settings(read_frozen(tmp_path))["heavy"].capacity == Capacity(1, 0.176)
    assert settings(found)["1.1"].capacity == Capacity(1, 0.158)  # 0.176 * 0.99 / 1.1


def test_the_runs_that_were_prepared_with_are_kept_as_well(monkeypatch, tmp_path):
    """The report publishes what follows from them."""
    monkeypatch.setattr(prepare, "own_deadlines", lambda: {"slam": 0.1, "speech": 1.0})
    monkeypatch.setattr(installation, "cores", lambda: 2)
    preparation = Preparation(Anywhere(tmp_path), Lines(), lambda _: True)
    found = preparation.calibrated()
    preparation.tuned(found, gated=True)
    kept = tmp_path / "data" / "preparation"
    alone = [Run(SCHEDULE, one) for one in records((kept / "alone.json.xz").read_bytes())]
    assert len(alone) == 9
    assert demand([one for one in alone if one.record.about["capacity"] == [2, 1.0]]) == pytest.approx(found["wanted"])
    assert len(records((kept / "tuning-gated.json.xz").read_bytes())) == 32 + 8 + 4 + 4
    assert Evidence.read(kept).schedules.keys() == {"errand", "tour", "workshop", "reception"}
    found_again = Evidence.read(tmp_path / "data")
    assert found_again.runs == {}
    assert len(found_again.searched["gated"]) == 32 + 8 + 4 + 4
    assert found_again.searched["ungated"] == []


class Prepares(Preparation):
    """Finds out at once, and counts."""

    def __init__(self, folder):
        super().__init__(Bench(folder), Lines(), lambda _: True)
        self.asked: list[object] = []

    def calibrated(self):
        self.asked.append("loads")
        return {"loads": {"light": [2, 0.8], "heavy": [1, 0.8]}}

    def tuned(self, frozen, *, gated):
        assert frozen["loads"]
        self.asked.append(gated)
        return {"weights": {"slam": 1}, "tried": []}

    def predicted(self, frozen):
        assert len(frozen["tuned"]) == 2
        self.asked.append("predicted")
        return {"misses": {}, "profiles": {}}


def test_loads_and_weights_are_found_out_once(tmp_path):
    preparation = Prepares(tmp_path)
    frozen: dict[str, object] = {}
    kept: list[str] = []
    command._prepare(preparation, frozen, tmp_path, kept.append)
    assert preparation.asked == ["loads", False, True, "predicted"]
    assert kept == ["loads and deadlines", "static weights, ungated", "static weights, gated", "predictions"]
    command._prepare(preparation, dict(read_frozen(tmp_path)), tmp_path, kept.append)
    assert len(preparation.asked) == len(kept) == 4


FOUND = {
    "loads": {"light": [2, 0.8], "heavy": [1, 0.4]},
    "deadlines": {},
    "wanted": {"slam": 0.2},
    "tuned": {"ungated": {}},
}


def calibrated_before(folder):
    """A bench where the calibration's run of each task alone was kept."""
    kept = folder / "data" / "preparation"
    kept.mkdir(parents=True)
    (kept / "alone.json.xz").write_bytes(block([a_run("alone", story="errand")]))
    return Bench(folder)


def test_preparation_goes_on_where_no_time_was_left(tmp_path):
    bench = calibrated_before(tmp_path)
    few = Preparation(bench, Lines(), lambda _: len(bench.done) < 5)
    with pytest.raises(OutOfTimeError):
        few.tuned(FOUND, gated=True)
    assert len(bench.done) == 5
    Preparation(bench, Lines(), lambda _: True).tuned(FOUND, gated=True)
    alone = [name for name, *_ in bench.done if name == "errand-alone"]
    assert len(bench.done) - len(alone) == 32 + 8 + 4 + 4  # none of them twice


def test_a_call_that_ends_during_preparation_is_not_a_failure(monkeypatch, tmp_path, capsys):
    def end(*_):
        raise OutOfTimeError

    monkeypatch.setattr(command, "_prepare", end)
    assert command.main(["--data", str(tmp_path), "--minutes", "1"]) == 0
    assert "the same command goes on" in capsys.readouterr().out


def test_a_machine_is_measured_once_and_for_all_calls(monkeypatch, tmp_path):
    monkeypatch.setattr(prepare, "this_machine", lambda: ABOUT["machine"])
    bench = calibrated_before(tmp_path)
    for _ in range(2):
        Preparation(bench, Lines(), lambda _: True).measured(FOUND)
    assert [name for name, *_ in bench.done] == ["errand-alone"] * ENOUGH
    kept = sorted((tmp_path / "data" / "preparation").glob("machine-*"))
    assert [one.configuration for path in kept for one in records(path.read_bytes())] == ["alone"] * ENOUGH
    monkeypatch.setattr(prepare, "this_machine", lambda: {**ABOUT["machine"], "kernel": "another"})
    Preparation(bench, Lines(), lambda _: True).measured(FOUND)
    assert len(bench.done) == 2 * ENOUGH


def test_a_machine_is_not_measured_without_the_calibration_that_it_is_compared_with(tmp_path):
    with pytest.raises(RecordError, match=r"no run of errand on 1 x 0\.4: calibrate again"):
        Preparation(Bench(tmp_path), Lines(), lambda _: True).measured(FOUND)


def test_what_is_predicted_from_is_the_run_of_this_machine(monkeypatch, tmp_path):
    """Its processors did one whole one: on 0.4 of one an input takes 2.5 times as long."""
    bench, told = calibrated_before(tmp_path), []
    monkeypatch.setattr(bench, "profiles", lambda *_: MEASURED)
    monkeypatch.setattr(prepare, "this_machine", lambda: ABOUT["machine"])
    monkeypatch.setattr(prepare, "load", lambda _: None)
    monkeypatch.setattr(prepare, "predict", lambda *given: told.append(given))
    assert Preparation(bench, Lines(), lambda _: True).predicted(FOUND)["profiles"] == MEASURED
    assert [name for name, *_ in bench.done] == ["errand-alone"] * (ENOUGH + 1)
    for _, _, due, profiles, capacity in told:
        assert (due, capacity) == (SCHEDULE, Capacity(1, 0.4))
        assert profiles.tasks["slam"].inputs[0].quantiles == pytest.approx((0.125, 0.125))
    assert len(told) == len(HELD_OUT)


def test_what_was_measured_is_reported_where_runs_fail(monkeypatch, tmp_path, capsys):
    write_schedule(tmp_path, "library", SCHEDULE)
    (tmp_path / "blocks").mkdir()
    (tmp_path / "blocks" / "2-heavy-01.json.xz").write_bytes(block([a_run("linux")]))

    def fail(*_, **__):
        raise DeployError("the node is gone")

    monkeypatch.setattr(command, "_run", fail)
    assert command.main(["library", "--data", str(tmp_path), "--report", str(tmp_path)]) == 1
    assert "the node is gone" in capsys.readouterr().out
    assert (tmp_path / "report.md").exists()


def test_a_report_is_published_only_where_somebody_asks_for_it(monkeypatch, tmp_path):
    """The campaign takes days: what is published meanwhile stays, and so do the pages that quote it."""
    write_schedule(tmp_path / "data", "library", SCHEDULE)
    (tmp_path / "data" / "blocks").mkdir()
    (tmp_path / "data" / "blocks" / "2-heavy-01.json.xz").write_bytes(block([a_run("linux")]))
    monkeypatch.setattr(command, "commit_folder", lambda *_: pytest.fail("it was committed"))
    monkeypatch.setattr(command, "_run", lambda *_, **__: True)
    assert command.main(["--commit", "--data", str(tmp_path / "data"), "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "report.md").exists()


def test_two_calls_on_one_machine_do_not_take_each_others_processors(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(command, "_run", lambda *_, **__: pytest.fail("it ran"))
    with exclusive.exclusively():
        assert command.main(["--data", str(tmp_path)]) == 1
    assert "other experiments run on this machine" in capsys.readouterr().out
    monkeypatch.setattr(command, "_run", lambda *_, **__: True)
    assert command.main(["--data", str(tmp_path)]) == 0


def test_an_unknown_story_or_configuration_is_refused(capsys):
    for arguments in (["magic"], ["--only", "magic"]):
        with pytest.raises(SystemExit):
            command.main(arguments)
    refused = capsys.readouterr().err
    assert "'magic': expected one of library, hotel" in refused
    assert "linux-gated" in refused


def test_only_the_data_is_committed_and_nothing_where_nothing_changed(monkeypatch, tmp_path):
    monkeypatch.setattr(deploy, "REPOSITORY", tmp_path)
    for name, value in (("GIT_AUTHOR_NAME", "a"), ("GIT_COMMITTER_NAME", "a"), ("EMAIL", "a@example.org")):
        monkeypatch.setenv(name, value)
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    (tmp_path / "data").mkdir()
    for name in ("code.py", "data/block"):
        (tmp_path / name).write_text("1", encoding="utf-8")
    subprocess.run(["git", "-C", str(tmp_path), "add", "code.py"], check=True)
    for _ in range(2):
        assert campaign.commit_folder(tmp_path / "data", "Keep a block") == ""
    log = ["git", "-C", str(tmp_path), "log", "--format=%s", "--name-only"]
    assert subprocess.run(log, capture_output=True, text=True, check=True).stdout.split("\n\n") == [
        "Keep a block", "data/block\n"
    ]  # fmt: skip


def test_runs_go_on_where_git_refuses_to_commit(tmp_path):
    bench, lines = Bench(tmp_path), Lines()
    made = Campaign(bench, {HEAVY: Setting(Capacity(1, 0.4), {})}, {HEAVY: {False: {}, True: {}}}, lines)
    assert made.run(CHOSEN, until=lambda _: True, commit=True) == 0  # the folder is outside of the repository
    assert len(bench.done) == len(CHOSEN)
    assert any(line.startswith("git ") and " add -- " in line for line in lines.said)
