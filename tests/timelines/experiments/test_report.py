"""The report of runs whose every time is known; and what is run, resumed and refused."""

from __future__ import annotations

import json
import time

import pytest

from tests.timelines.experiments.synthetic import fresh, write_run
from timelines.demo.deploy import DeployError
from timelines.experiments import __main__ as command
from timelines.experiments import installation
from timelines.experiments.report import write_report
from timelines.experiments.run import RUN

PLANS = [(-1.0, (), 1.0), (0.5, ("speech",), 1.5)]
SUSPENDED = [("speech", index) for index in range(5, 10)]


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    for repeat, slow in enumerate((0.2, 0.3)):
        baseline = fresh(folder / "exp3-x1" / "linux-default" / str(repeat))
        write_run(baseline, "linux-default", "Linux default", service={"slam": slow, "speech": 0.01})
        better = fresh(folder / "exp3-x1" / "cfs-ca" / str(repeat))
        service = {"slam": 0.1, "speech": 0.01}
        write_run(better, "cfs-ca", "CFS CA", service=service, plans=PLANS, skipped=SUSPENDED)
    write_run(
        fresh(folder / "exp3-x1" / "ideal" / "0"), "ideal", "each task alone", service={"slam": 0.05, "speech": 0.01}
    )
    undrained = fresh(folder / "exp3-x1" / "weight" / "0")
    write_run(undrained, "weight", "Weight", service={"slam": 0.1, "speech": 0.1}, drained=False)
    about = folder / "exp3-x1" / "cfs-ca" / "1" / RUN
    busy = json.loads(about.read_text(encoding="utf-8")) | {"load": {"before": [9.0, 9.0, 9.0]}}
    about.write_text(json.dumps(busy), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def kept(out):
    folder = out / "kept"
    assert write_report(out, out / "datasets", folder) == folder / "report.md"
    return folder


@pytest.fixture(scope="module")
def text(kept):
    return (kept / "report.md").read_text(encoding="utf-8")


def test_it_compares_with_the_baseline_repeat_by_repeat(kept, text):
    (row, *_) = [line for line in text.splitlines() if line.startswith("| CFS CA | 1 s")]
    cells = [cell.strip() for cell in row.split("|")]
    assert cells[2] == "1 s"
    assert cells[3].startswith("2.45 [")  # 2 s and 3 s against 1 s: the root of 2 times 3
    assert cells[5:9] == ["15", "5", "0", "0"]
    assert "a test, 2 cores" in text
    assert "CFS CA: speech has done 5 inputs that the recorder did not hear of" in text
    assert "Linux default: speech has done" not in text
    for line in text.splitlines():
        if line.startswith("!["):
            picture = kept / line.partition("(")[2].rstrip(")")
            assert picture.read_text(encoding="utf-8").startswith("<?xml")


def test_goals_come_first_and_each_figure_is_kept_for_programs(kept, text):
    assert text.index("## Goals, CFS CA") < text.index("## exp3 at real pace")
    assert "on equal work at least 0.95 x of Linux default | " in text
    measured = json.loads((kept / "measures.json").read_text(encoding="utf-8"))
    figures = {(one["configuration"], one["repeat"]): one["total_time"] for one in measured}
    assert figures["linux-default", 0] == pytest.approx(2.0)
    assert figures["linux-default", 1] == pytest.approx(3.0)
    assert figures["cfs-ca", 0] == figures["cfs-ca", 1] == pytest.approx(1.0)


def test_response_times_are_multiples_of_the_ideal(text):
    rows = [line.split("|") for line in text.splitlines() if line.startswith("| CFS CA |")]
    assert any(row[-2].strip().startswith("2 ") for row in rows)  # 0.1 s, which takes 0.05 s alone


def test_doubtful_runs_are_named(text):
    assert "Weight: queues were not empty" in text
    assert "CFS CA: queues were not empty" not in text


def test_a_run_on_a_busy_machine_says_so(text):
    assert "CFS CA: the machine had a load of 9.0 before the run." in text
    assert text.count("the machine had a load") == 1


def test_the_report_can_be_kept_apart_from_the_raw_data(out, kept):
    assert (kept / "measures.json").is_file()
    assert list((kept / "figures").glob("*.svg"))
    assert {path.name for path in out.iterdir()} == {"exp3-x1", "kept"}


def test_figures_label_directly_and_say_what_they_show(kept, text):
    pictures = [line for line in text.splitlines() if line.startswith("![")]
    assert len({line.partition("](")[0] for line in pictures}) == len(pictures)
    assert "legend" not in "".join(path.read_text(encoding="utf-8") for path in (kept / "figures").glob("*.svg"))


def test_a_report_without_runs_is_refused(tmp_path):
    with pytest.raises(DeployError, match="no finished run"):
        write_report(tmp_path, tmp_path, tmp_path)


@pytest.fixture
def runs(monkeypatch):
    """What is installed and run, without a node; `fails_after` runs the node is gone."""
    done, clock = [], {"now": 0.0, "fails_after": 99}
    monkeypatch.setattr(installation, "install", lambda configuration: done.append(configuration.agent))
    monkeypatch.setattr(installation, "can", lambda _: True)
    monkeypatch.setattr(time, "monotonic", lambda: clock["now"])

    def execute(trial, timeline, _datasets, folder, _policy):
        if len(done) > clock["fails_after"]:
            raise DeployError("the node is gone")
        fresh(folder)
        service = {"slam": 0.1, "speech": 0.1}
        write_run(folder, trial.configuration.name, trial.configuration.title, service=service)
        done.append((timeline.stem, trial.configuration.name, folder.name))
        clock["now"] += 50.0

    monkeypatch.setattr(command, "execute", execute)
    return done, clock


ARGUMENTS = ("exp3", "--repeats", "2", "--only", "linux-default", "cfs-ca", "--paces", "1")
FOUR = [("exp3", name, repeat) for repeat in "01" for name in ("linux-default", "cfs-ca")]


def test_repeats_are_interleaved_and_what_is_finished_is_not_run_again(tmp_path, runs):
    done, clock = runs
    clock["fails_after"] = 3
    assert command.main([*ARGUMENTS, "--out", str(tmp_path)]) == 1
    assert done == [False, *FOUR[:3]]
    done.clear()
    assert command.main([*ARGUMENTS, "--out", str(tmp_path)]) == 0
    assert done == [False, FOUR[3]]
    assert (tmp_path / "exp3-x1" / "cfs-ca" / "1" / RUN).is_file()


def test_no_run_is_begun_that_would_end_too_late(tmp_path, runs, capsys):
    done, _ = runs
    assert command.main([*ARGUMENTS, "--minutes", "2.6", "--out", str(tmp_path)]) == 0
    assert done == [False, *FOUR[:3]]  # 156 s: the fourth would end after 200 s
    assert "1 runs are left" in capsys.readouterr().out


def test_an_unknown_configuration_is_refused(capsys):
    with pytest.raises(SystemExit):
        command.main(["exp3", "--only", "magic"])
    assert "linux-default" in capsys.readouterr().err
