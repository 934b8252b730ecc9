"""What the runs under light load lost of the sound no longer costs a command."""

from __future__ import annotations

import pytest

from modules.speech.listener import Listener
from modules.speech.task import Speech
from robotkit import Received
from tests.modules.sounds import needs_voices
from timelines.datasets import speech
from timelines.datasets.readers import read
from timelines.experiments.__main__ import DATA
from timelines.experiments.record import records
from timelines.experiments.stories import SCENARIOS
from timelines.scenarios.scenario import load


@pytest.fixture
def chunks(tmp_path):
    """The sound of the story `hotel`, as it is played."""
    speech.write(tmp_path, load(SCENARIOS / "hotel.yaml").script, progress=lambda _: None)
    return [payload for _, payload in read(tmp_path.parent, tmp_path.name)]


@needs_voices
def test_what_these_runs_received_is_heard_as_if_nothing_had_been_lost(chunks):
    paths = sorted((DATA / "blocks").glob("3-light-*.json.xz"))
    runs = [one for path in paths for one in records(path.read_bytes()) if one.story == "hotel"]
    most = max(run.accuracy["talk: speech"][1] for run in runs)
    fewer = [run.columns["speech"]["audio"].fates for run in runs if run.accuracy["talk: speech"][1] < most]
    assert fewer
    whole = [one["keyword"] for one in results(chunks, "i" * len(chunks))]
    assert all([one["keyword"] for one in results(chunks, fates)] == whole for fates in fewer)


def results(chunks, fates):
    task = Speech(Listener())
    due = enumerate(zip(chunks, fates, strict=False))  # the last chunk ends with the story, and is not due
    received = (Received(chunk, (number + 1) * 100_000_000, 0) for number, (chunk, fate) in due if fate != "l")
    return [result.value for one in received for result in task.process(one)]
