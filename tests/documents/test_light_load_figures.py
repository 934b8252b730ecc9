"""What the pages say of light load, and of what cost it, is what the committed data gives."""

from __future__ import annotations

import re
from collections import defaultdict
from statistics import fmean, median

import pytest

from tests.documents.experiment_pages import DATA, DETAILS, PAGE, PREPARATION, REACTION, README, REPORT
from timelines.experiments.configurations import CONFIGURATIONS
from timelines.experiments.evidence import read_schedule
from timelines.experiments.metrics import Run
from timelines.experiments.rates import whole
from timelines.experiments.record import records
from timelines.experiments.tables import percent


@pytest.fixture(scope="module")
def light():
    """Runs under light load by configuration."""
    runs = defaultdict(list)
    for path in sorted((DATA / "blocks").glob("3-light-*.json.xz")):
        for one in records(path.read_bytes()):
            runs[one.configuration].append(Run(read_schedule(DATA / "schedules" / f"{one.story}.json.xz"), one))
    return runs


def commands_heard(runs):
    """While talking, in percent of those that were said in all runs."""
    judged = [run.record.accuracy["talk: speech"] for run in runs]
    return sum(part * of for _, part, _, of, _ in judged) / sum(of for _, _, _, of, _ in judged)


@pytest.mark.parametrize("name", ["linux", "static", "weights", "weights-gated", "limits-gated"])
def test_what_light_load_costs(name, light):
    runs = light[name]
    late = [sorted(run.record.late["robot/imu/raw"]) for run in runs]
    cells = [
        percent(whole(runs, "slam")).partition(" [")[0],
        f"{1000 * fmean(run.tail('navigation') for run in runs):.0f} ms",
        f"{sum(run.tail('slam') >= 50 for run in runs)}",
        f"{commands_heard(runs):.1f}",
        f"{median(one[int(0.99 * len(one))] / 10 for one in late):.0f} ms",
        f"{sum(run.record.columns['speech']['audio'].fates.count('l') for run in runs)}",
    ]
    assert len(runs) == 20
    assert f"| {CONFIGURATIONS[name].title} | {' | '.join(cells)} |" in PAGE


def test_what_was_lost_follows_what_was_late(light):
    near, lost = [], []
    for run in (run for own in light.values() for run in own):
        late = run.record.late["robot/imu/raw"]
        for number, fate in enumerate(run.record.columns["imu"]["raw"].fates):
            near.append(max(late[max(0, number - 20) : number + 1]) > 50)  # 0.1 s at 200 Hz, and 5 ms
            lost.append(fate == "l")
    both = sum(a and b for a, b in zip(near, lost, strict=True))
    assert f"of {sum(lost)} lost IMU samples {both} came at most 0.1 s after one that was more than 5 ms late" in PAGE
    assert f"as did {100 * fmean(near):.0f} % of all" in PAGE


def from_when_due(run, task):
    """p99 over what is wanted, in milliseconds, with what the player was late by."""
    keys = run.schedule.inputs[task]
    both = zip(run.schedule.of(task), run.ended(task), strict=True)
    wanted = [(run.record.late[keys[due.input]][due.number] / 10, end) for due, end in both if due.wanted]
    return sorted(late + 1000 * (60 if end.response is None else end.response) for late, end in wanted)[
        int(0.99 * len(wanted))
    ]


def test_what_light_load_costs_from_when_inputs_are_due(light):
    plain, weights, gated = (
        fmean(from_when_due(run, "navigation") for run in light[name]) for name in ("linux", "weights", "weights-gated")
    )
    said = (
        f"p99 is {plain:.0f} ms under Linux' default, {weights:.0f} ms under context weights and {gated:.0f} ms gated"
    )
    assert f"{said}, where {1.2 * plain + 5:.0f} ms would be allowed" in PAGE


def test_what_is_said_of_light_load(light):
    slam = {name: f"{100 * fmean(run.tally('slam').hit for run in own):.1f}" for name, own in light.items()}
    last = {name: 1000 * fmean(run.tail("navigation") for run in own) for name, own in light.items()}
    assert slam["weights"] == slam["weights-gated"]
    assert f"and {commands_heard(light['weights']):.0f} % of commands were heard instead of" in README
    assert f"were heard instead of {commands_heard(light['linux']):.0f}." in README
    said = f"SLAM had {slam['weights']} % instead of {slam['linux']}. Navigation's p99 was {last['weights']:.0f} ms"
    assert said in README
    assert f"the first law allows {1.2 * last['linux'] + 5:.0f} ms" in PAGE
    heard = defaultdict(list)
    for run in (run for own in light.values() for run in own):
        pieces = run.record.columns["speech"]["audio"].fates.count("l")
        heard[run.record.story].append((run.record.accuracy["talk: speech"][1], pieces))
    fewer = [pieces for own in heard.values() for part, pieces in own if part < max(own)[0]]
    assert f"All {len(fewer)} runs in which a command fewer was heard" in PAGE
    assert set(fewer) == {1}


def test_what_the_first_law_says_of_hit_rates():
    sections = re.findall(r"### first law: the hit rate of no task [^\n]*\n(.*?)\n###", DETAILS, re.DOTALL)
    gains = [float(gain) for one in sections for gain in re.findall(r"\| ([-+.\d]+) \[", one)]
    least = re.findall(r"\| light \| first law: the hit rate of no task [^|]*\|.*\| ([\d.]+) \| not shown \|", REPORT)
    gated, ungated = (f"{float(one):.2f}" for one in least)
    assert f"no task hits more than {100 * (0.01 - min(gains)):.2f} points less" in PAGE
    assert f"p is {gated} (gated) and {ungated}" in PAGE


@pytest.mark.parametrize("millicores", [100, 500])
@pytest.mark.parametrize(("name", "title"), [("linux", "Linux default"), ("weights", "context weights")])
def test_what_the_routers_request_changes(millicores, name, title):
    cells = []
    for task in ("navigation", "imu"):
        found = sorted(
            ended.response
            for one in records((PREPARATION / "router-request.json.xz").read_bytes())
            if (one.block, one.configuration) == (millicores, name)
            for ended in Run(read_schedule(PREPARATION / "schedules" / f"{one.story}.json.xz"), one).ended(task)
            if ended.response is not None
        )
        cells += [f"{1000 * found[int(part * len(found))]:.1f} ms" for part in (0.9, 0.97, 0.99)]
    assert f"| {millicores}m | {title} | {' | '.join(cells)} |" in REACTION


@pytest.mark.parametrize(("block", "player"), [(0, "ordinary process"), (1, "realtime priority")])
@pytest.mark.parametrize(
    ("name", "title"),
    [("linux", "Linux default"), ("weights", "context weights"), ("weights-gated", "context weights, gated")],
)
def test_how_late_a_player_beside_weighted_tasks_is(block, player, name, title):
    every = records((PREPARATION / "player-priority.json.xz").read_bytes())
    own = [one for one in every if (one.block, one.configuration) == (block, name)]
    late = sorted(tenths / 10 for one in own for of_key in one.late.values() for tenths in of_key)
    fates = "".join(column.fates for one in own for inputs in one.columns.values() for column in inputs.values())
    assert f"{len(fates):,} deliveries" in REACTION
    cells = [f"{late[int(0.99 * len(late))]:.1f} ms", f"{late[-1]:.1f} ms", str(fates.count("l"))]
    assert f"| {player} | {title} | {' | '.join(cells)} |" in REACTION
