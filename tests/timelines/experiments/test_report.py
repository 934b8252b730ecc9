"""The report of runs whose every time is known; and what is run, resumed and refused."""

from __future__ import annotations

import pytest

from tests.timelines.experiments.synthetic import fresh, write_run
from timelines.demo.deploy import DeployError
from timelines.experiments import __main__ as command
from timelines.experiments.report import write_report
from timelines.experiments.run import RUN

PLANS = [(-1.0, (), 1.0), (0.5, ("speech",), 1.5)]
SUSPENDED = [("speech", index) for index in range(5, 10)]


@pytest.fixture
def out(tmp_path):
    for repeat, slow in enumerate((0.2, 0.3)):
        baseline = fresh(tmp_path / "exp3" / "linux-default" / str(repeat))
        write_run(baseline, "linux-default", "Linux default", service={"slam": slow, "speech": 0.01})
        better = fresh(tmp_path / "exp3" / "cfs-ca" / str(repeat))
        service = {"slam": 0.1, "speech": 0.01}
        write_run(better, "cfs-ca", "CFS CA", service=service, plans=PLANS, skipped=SUSPENDED)
    return tmp_path


def test_it_compares_with_the_baseline_repeat_by_repeat(out):
    text = write_report(out).read_text(encoding="utf-8")
    (row, *_) = [line for line in text.splitlines() if line.startswith("| CFS CA | 1 s")]
    cells = [cell.strip() for cell in row.split("|")]
    assert cells[2:5] == ["1 s", "2.5 [2, 3] x", "2.5 [2, 3] x"]  # 2 s and 3 s against 1 s
    assert cells[5:9] == ["15", "5", "0", "0"]
    assert "a test, 2 cores" in text
    assert "CFS CA: speech has done 5 inputs that the recorder did not hear of" in text
    assert "Linux default: speech has done" not in text
    for line in text.splitlines():
        if line.startswith("!["):
            picture = out / line.partition("(")[2].rstrip(")")
            assert picture.read_text(encoding="utf-8").startswith("<?xml")


def test_doubtful_runs_are_named(out):
    folder = fresh(out / "exp3" / "weight" / "0")
    write_run(folder, "weight", "Weight", service={"slam": 0.1, "speech": 0.1}, drained=False)
    assert "Weight: queues were not empty" in write_report(out).read_text(encoding="utf-8")


def test_without_runs_there_is_nothing_to_report(tmp_path):
    with pytest.raises(DeployError, match="no finished run"):
        write_report(tmp_path)


def test_repeats_are_interleaved_and_what_is_finished_is_not_run_again(tmp_path, monkeypatch):
    done = []
    monkeypatch.setattr(command.installation, "install", lambda configuration: done.append(configuration.agent))

    def execute(configuration, timeline, _datasets, folder):
        if len(done) > 3:
            raise DeployError("the node is gone")
        fresh(folder)
        write_run(folder, configuration.name, configuration.title, service={"slam": 0.1, "speech": 0.1})
        done.append((timeline.stem, configuration.name, folder.name))

    monkeypatch.setattr(command, "execute", execute)
    arguments = ["exp3", "--repeats", "2", "--only", "linux-default", "cfs-ca", "--out", str(tmp_path)]
    assert command.main(arguments) == 1
    first = [("exp3", name, repeat) for repeat in "01" for name in ("linux-default", "cfs-ca")]
    assert done == [False, *first[:3]]
    done.clear()
    assert command.main(arguments) == 0
    assert done == [False, first[3]]
    assert (tmp_path / "exp3" / "cfs-ca" / "1" / RUN).is_file()


def test_an_unknown_configuration_is_refused(capsys):
    with pytest.raises(SystemExit):
        command.main(["exp3", "--only", "magic"])
    assert "linux-default" in capsys.readouterr().err
