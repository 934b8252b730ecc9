"""What a person sees of the decision bus."""

from __future__ import annotations

import json
from typing import Any

import pytest
from rich.console import Console

from contextpolicy.bus.view import BusView
from contextpolicy.bus.view_tables import live
from tests.bus.messages import APPLIED, BOARD, KEY, a_node, plan, step, target


def heard(*messages: tuple[str, dict[str, Any]]) -> BusView:
    view = BusView()
    for key, message in messages:
        view.take(key, json.dumps(message).encode())
    return view


def stages(view: BusView) -> dict[str, str | None]:
    policy = view.policies["robot/delivery"]
    return {task: policy.stage(task) for task in policy.tasks}


def drawn(view: BusView, now: float = 103.0, width: int = 120) -> str:
    console = Console(width=width, color_system=None)
    with console.capture() as capture:
        console.print(live(view, now, width))
    return capture.get()


def test_a_policy_on_the_screen() -> None:
    view = heard((KEY, plan()), (APPLIED, step("inForce", 0.99)))
    lines = drawn(view).splitlines()
    assert lines[0].rstrip() == "robot/delivery   context: moving   for 3 s: imu: context moving entered"
    rows = [[cell.strip() for cell in line.strip("│").split("│")] for line in lines if line.startswith("│")]
    assert rows == [
        ["slam", "10", "990m", "-", "-", "-", "in force"],
        ["speech", "0", "10m", "-", "-", "-", "planned   suspended"],
    ]


def test_plan_from_a_fast_clock_has_age_zero() -> None:
    assert "for 0 s:" in drawn(heard((KEY, plan())), now=99.5)


@pytest.mark.parametrize("width", [40, 60, 80])
def test_a_narrow_terminal_loses_nothing(width: int) -> None:
    view = BusView()
    view.take_board({**BOARD, "plan": plan(tasks={"navigation-and-mapping": plan()["tasks"]["slam"]})})
    text = drawn(view, width=width)
    assert all(len(line.rstrip()) <= width for line in text.splitlines())
    assert {"navigation-and-mapping", "990m", "throttled", "imu", "0.2", "silent"} <= set(text.split())
    assert "…" not in text


def test_unresponsive_operator_is_marked() -> None:
    view = heard((KEY, plan()))
    assert "its operator does not respond: showing its last report" in drawn(view)
    view.take_board(BOARD)
    assert "its operator does not respond" not in drawn(view)


def test_a_policy_that_was_paused_has_no_plan() -> None:
    view = heard((KEY, plan()))
    view.take_board({**BOARD, "plan": None})
    assert drawn(view).strip() == "no plans yet"


@pytest.mark.parametrize("width", [40, 200])
def test_a_fake_operator_does_not_control_the_terminal(width: int) -> None:
    """A pod that a tenant dressed up as one may answer with anything, such as what sets the clipboard."""
    escape = "\x1b]52;c;cm0=\x07"
    shown = drawn(
        heard((KEY, plan(cause=escape, tasks={f"slam{escape}": plan()["tasks"]["slam"]}, targets=[]))), width=width
    )
    assert "slam" in shown
    assert not {"\x1b", "\x07"} & {*shown}


def test_brackets_in_a_cause_are_not_markup() -> None:
    assert "mic: x[y] > 1 is 1" in drawn(heard((KEY, plan(cause="mic: x[y] > 1 is 1"))))


@pytest.mark.parametrize(
    ("steps", "stage"),
    [
        ([], "planned"),
        ([step("accepted", 0.99)], "accepted"),
        ([step("accepted", 0.7)], "planned"),
        ([step("accepted", 0.99), step("inForce", 0.99)], "inForce"),
        ([step("inForce", 0.99), step("accepted", 0.99)], "inForce"),
    ],
    ids=["nothing", "accepted", "a step on the way", "in force", "the answer after the watch"],
)
def test_stage_of_a_task_is_its_containers(steps: list[dict[str, Any]], stage: str) -> None:
    assert stages(heard((KEY, plan()), *((APPLIED, one) for one in steps)))["slam"] == stage


def test_stage_of_a_task_is_its_slowest_containers() -> None:
    two = [target("slam", 0.5, limit=0.5), {**target("slam", 0.5), "pod": "slam-2", "limit": 0.1}]
    assert stages(heard((KEY, plan(targets=two))))["slam"] == "planned"


def test_equal_limit_is_in_force_already() -> None:
    assert stages(heard((KEY, plan(targets=[target("slam", 0.99, limit=0.99)])))) == {"slam": "inForce", "speech": None}


def test_an_uncapped_task_is_in_force_with_the_limit_it_keeps() -> None:
    kept = target("slam", 0.99, limit=2.0, quota=2.0)
    assert stages(heard((KEY, plan(control="Suspend", targets=[kept]))))["slam"] == "inForce"


def test_weight_has_a_stage_only_once_resized() -> None:
    message = plan(control="Weight", targets=[target("slam", 0.99, limit=2.0, quota=2.0, weight=0.99)])
    assert stages(heard((KEY, message)))["slam"] is None
    assert stages(heard((KEY, message), (APPLIED, step("accepted", 2.0))))["slam"] == "accepted"


def test_a_new_plan_keeps_what_it_does_not_change() -> None:
    view = heard((KEY, plan()), (APPLIED, step("inForce", 0.99)), (KEY, plan(sequence=2)))
    assert stages(view)["slam"] == "inForce"
    view.take(KEY, json.dumps(plan(sequence=3, targets=[target("slam", 0.5, limit=0.99)])).encode())
    assert stages(view)["slam"] == "planned"


def test_a_pod_that_replaces_another_of_its_name_has_reached_no_stage() -> None:
    view = heard((KEY, plan()), (APPLIED, step("inForce", 0.99)))
    view.take(KEY, json.dumps(plan(edition=1, targets=[target("slam", 0.99, uid="uid-another")])).encode())
    assert stages(view)["slam"] == "planned"


@pytest.mark.parametrize("change", [{"mode": "DryRun"}, {"scheduler": "Realtime"}])
def test_dry_run_and_realtime_have_no_stage(change: dict[str, str]) -> None:
    assert stages(heard((KEY, plan(**change)))) == {"slam": None, "speech": None}


def test_a_node_that_fell_back_to_cfs_is_resized() -> None:
    nodes = {"robot-1": a_node("CFS"), "robot-2": a_node("Realtime")}
    targets = [target("slam", 0.99), {**target("speech", 0.01), "node": "robot-2"}]
    message = plan(scheduler="Realtime", nodes=nodes, targets=targets)
    assert stages(heard((KEY, message))) == {"slam": "planned", "speech": None}


@pytest.mark.parametrize("late", [{"sequence": 4}, {"run": 0, "sequence": 9}, {"edition": 0}])
def test_an_older_plan_that_arrives_late_changes_nothing(late: dict[str, int]) -> None:
    newest = plan(sequence=5, edition=1, contexts=[])
    view = heard((KEY, newest))
    assert view.take(KEY, json.dumps({**newest, **late, "contexts": ["moving"]}).encode()) is None
    assert view.policies["robot/delivery"].contexts == []


def test_withdrawn_plan_is_dropped() -> None:
    view = heard((KEY, plan()))
    assert view.take(KEY, None) == {"policy": "robot/delivery", "withdrawn": True}
    assert view.take(KEY, None) is None
    assert view.policies == {}


def test_board_is_dropped_with_its_plan() -> None:
    view = heard((KEY, plan()))
    view.take_board(BOARD)
    view.take(KEY, None)
    assert view.boards == {}


@pytest.mark.parametrize(
    ("key", "payload"),
    [
        (KEY, b"\xff"),
        (KEY, b"{}"),
        (KEY, b"[1]"),
        (KEY, json.dumps(plan(targets=[{}])).encode()),
        (KEY, json.dumps(plan(tasks={"slam": {"weight": 1.0, "share": "all", "suspended": False}})).encode()),
        (KEY, json.dumps(plan(tasks={"slam": {"weight": [], "share": 0.1, "suspended": False}})).encode()),
        (KEY, json.dumps(plan(targets=[{**target("slam", 1.0), "cores": "1"}])).encode()),
        (KEY, json.dumps(plan(time=float("inf"))).encode()),
        (KEY, json.dumps(plan(tasks={"slam": 1})).encode()),
        (KEY, json.dumps(plan(time=None)).encode()),
        (APPLIED, b"{}"),
        (APPLIED, json.dumps(step("lost", 0.99)).encode()),
        (APPLIED, json.dumps(step("accepted", 0.99, task="unknown")).encode()),
    ],
)
def test_unreadable_message_changes_nothing(key: str, payload: bytes) -> None:
    view = heard((KEY, plan()))
    before = json.dumps(view.policies["robot/delivery"].as_json())
    assert view.take(key, payload) is None
    assert json.dumps(view.policies["robot/delivery"].as_json()) == before


@pytest.mark.parametrize(
    "change",
    [
        {"policy": "no-slash"},
        {"containers": [{"task": "slam"}]},
        {"containers": [{"task": "slam", "limit": "1", "use": None, "throttled": None}]},
        {"streams": {"imu": {"age": "long", "samples": 7, "silent": False}}},
        {"streams": []},
        {"reactions": {"count": 3}},
        {"reactions": {}},
    ],
)
def test_unreadable_board_is_not_shown(change: dict[str, Any]) -> None:
    view = BusView()
    view.take_board({**BOARD, **change})
    assert view.boards == {}


def test_board_adds_usage_streams_and_reaction_times() -> None:
    view = BusView()
    view.take_board(BOARD)
    text = drawn(view)
    rows = [[cell.strip() for cell in line.strip("│").split("│")] for line in text.splitlines() if line.startswith("│")]
    assert ["slam", "10", "990m", "990m", "500m", "25%", "planned"] in rows
    assert ["imu", "0.2 s", "7", "heard"] in rows
    assert ["mic", "-", "0", "silent"] in rows
    assert "sample to change in force: median 20 ms, worst 100 ms, last 30 ms of the latest 3" in text
