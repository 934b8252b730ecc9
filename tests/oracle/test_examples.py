"""Stories in which planner and model once differed, each with what the planner did then."""

from __future__ import annotations

from typing import Any

import pytest

from tests.oracle.comparison import difference
from tests.oracle.story import Happening, Memory, Story, Version
from tests.oracle.units import SECOND
from tests.planning.builders import a_context, a_stream, a_task


def story(*happenings: Any, edits: Any = (), until: int = 8, remembered: Any = (), **spec: Any) -> Story:
    """Samples are (time, stream), or with the value of x; `edits` are (time, changes of the spec)."""
    versions = [Version(0, spec)]
    for at, changes in edits:
        versions.append(Version(at * SECOND, {**versions[-1].spec, **changes}))
    heard = [Happening(int(at * SECOND), stream, {"x": (*x, 1)[0], "p": True}) for at, stream, *x in happenings]
    return Story(versions, heard, until * SECOND, remembered=dict(remembered))


def counted(name: str, over: str, **fields: Any) -> dict[str, Any]:
    return a_stream(name, features=[{"name": "countx", "op": "count", "over": over}], **fields)


TASKS = [a_task("t0"), a_task("t1", priority=2)]
STALE = a_stream("a", staleAfter="2s")
FALLEN_BACK = {"streams": [STALE], "fallback": "ctx0", "contexts": [a_context("ctx0", tasks={"t0": {"weight": 3}})]}
WHILE_FALLEN_BACK = {**TASKS[1], "activity": [{"when": "contexts.ctx0", "hold": "3s"}]}

STORIES = {
    "a window that slid began an activity": story(
        (1, "a"), streams=[counted("a", "3s")], tasks=[a_task("t0", activity=[{"stream": "a", "hold": "1s"}])]
    ),
    "and a pre-condition": story(
        (1, "a"), streams=[counted("a", "3s")], tasks=[a_task("t0", requires=[{"when": "a.p", "hold": "1s"}])]
    ),
    "and renewed a hold of another task": story(
        (1, "a"),
        streams=[counted("a", "2s")],
        tasks=[a_task("t0", activity=[{"when": "a.p", "hold": "3s"}]), a_task("t1")],
    ),
    "no plan until a stream was heard or silent": story(streams=[STALE], tasks=TASKS),
    "nor by force": story(
        streams=[STALE],
        tasks=TASKS,
        contexts=[a_context("ctx0", tasks={"t0": {"suspend": True}})],
        force={"context": "ctx0", "until": SECOND},
    ),
    "a stream that was never heard had no age": story(
        streams=[a_stream("a")],
        tasks=TASKS,
        contexts=[a_context("ctx0", "age(a) > 1.125", {"t0": {"weight": 8}})],
    ),
    "a scale lifted a suspension": story(
        streams=[a_stream("a")],
        tasks=TASKS,
        contexts=[
            a_context("ctx0", "!heard(a)", {"t0": {"suspend": True}}),
            a_context("ctx1", "!heard(a)", {"t0": {"scale": 2}}),
        ],
    ),
    "a scale took the place of a weight": story(
        (1, "a"),
        streams=[a_stream("a")],
        tasks=TASKS,
        contexts=[
            a_context("ctx0", "heard(a)", {"t0": {"weight": 8}}),
            a_context("ctx1", "heard(a)", {"t0": {"scale": 0.5}}),
        ],
    ),
    "a context began at the instant at which its condition ended": story(
        (1, "a"),
        streams=[counted("a", "2s")],
        tasks=TASKS,
        contexts=[
            a_context("ctx0", "!heard(a) || a.countx > 0", {"t0": {"weight": 8}}, enterAfter="3s", exitAfter="1s")
        ],
    ),
    "and so did one that reads another": story(
        (1, "a"),
        streams=[counted("a", "2s")],
        tasks=TASKS,
        contexts=[
            a_context("ctx0", "contexts.ctx1", {"t0": {"weight": 8}}, enterAfter="2s", exitAfter="1s"),
            a_context("ctx1", "a.countx > 0"),
        ],
    ),
    "an event came too late for a context that ended at its instant": story(
        (1, "a"),
        (3, "b"),
        streams=[counted("a", "1s"), a_stream("b")],
        tasks=[a_task("t0", activity=[{"when": "b.p && contexts.ctx0", "hold": "1s"}]), a_task("t1")],
        contexts=[a_context("ctx0", "a.countx > 0", exitAfter="1s")],
    ),
    "an edit was an event for what reads the fallback": story(
        until=10, edits=[(4, {"reserve": "500m"})], tasks=[TASKS[0], WHILE_FALLEN_BACK], **FALLEN_BACK
    ),
    "of three events that fall, only two were compared": story(
        (3.5, "a", 3),
        (4, "a", 2),
        (4.75, "a", 1),
        streams=[counted("a", "5s") | {"features": [{"name": "meanx", "op": "mean", "of": "a.x", "over": "250ms"}]}],
        tasks=[a_task("t0", activity=[{"scoreFrom": "a.meanx + 1.0", "decay": "2500ms"}]), a_task("t1")],
    ),
    "an event went on after its score was 0": story(
        (1, "a"),
        (4, "b"),
        (5, "a"),
        streams=[counted("a", "2s"), a_stream("b")],
        tasks=[
            a_task("t0", activity=[{"when": "a.countx > 0 && !heard(b)", "until": "a.x > 5", "scoreFrom": "a.countx"}]),
            a_task("t1"),
        ],
    ),
    "a context that went on by its condition as a fallback ended was an event": story(
        (6, "a"),
        until=10,
        tasks=[TASKS[0], WHILE_FALLEN_BACK],
        **FALLEN_BACK | {"contexts": [a_context("ctx0", "a.p", {"t0": {"weight": 3}})]},
    ),
    "an event that fell was dropped for one that was as strong for a step": story(
        (1, "a", 3),
        (2.25, "a", 2),
        streams=[a_stream("a")],
        tasks=[a_task("t0", activity=[{"scoreFrom": "a.x", "hold": "500ms", "decay": "5s"}]), a_task("t1")],
    ),
    "a context that a window turned was an event": story(
        (1, "a"),
        streams=[counted("a", "2s")],
        tasks=[a_task("t0", activity=[{"when": "contexts.ctx0", "hold": "2s"}]), a_task("t1")],
        contexts=[a_context("ctx0", "a.countx == 0")],
    ),
    "and one that an age turned, for a pre-condition": story(
        (1, "a"),
        streams=[a_stream("a")],
        tasks=[a_task("t0", requires=[{"when": "contexts.ctx0", "hold": "2s"}]), a_task("t1")],
        contexts=[a_context("ctx0", "age(a) > 1.0")],
    ),
    "and one that silence turned, through a second context": story(
        (1, "a"),
        streams=[STALE],
        fallback="ctx0",
        tasks=[a_task("t0", activity=[{"when": "contexts.ctx1", "hold": "2s"}]), a_task("t1")],
        contexts=[a_context("ctx0", tasks={"t0": {"weight": 3}}), a_context("ctx1", "contexts.ctx0")],
    ),
    "one that a sample began is an event after its delay": story(
        (1, "a"),
        streams=[a_stream("a")],
        tasks=[a_task("t0", activity=[{"when": "contexts.ctx0", "hold": "2s"}]), a_task("t1")],
        contexts=[a_context("ctx0", "a.p", enterAfter="1s")],
    ),
    "one that silence and a sample after its delay began at one instant was none": story(
        (0.5, "b"),
        streams=[STALE, a_stream("b")],
        fallback="ctx0",
        tasks=[TASKS[0], WHILE_FALLEN_BACK],
        contexts=[a_context("ctx0", "b.p", enterAfter="1500ms")],
    ),
    "a suspended task ran after a restart as nothing was active": story(
        streams=[a_stream("a")],
        tasks=[a_task("t0", activity=[{"when": "a.p"}])],
        remembered={"t0": Memory(0.0, suspended=True)},
    ),
    "a task at rest was suspended by a restart": story(
        streams=[a_stream("a")],
        tasks=[a_task("t0", activity=[{"when": "a.p"}], requires=[{"when": "a.p"}])],
        remembered={"t0": Memory(0.0, suspended=False)},
    ),
    "an edit made a task wait again for a stream whose time was over": story(
        streams=[STALE | {"staleAfter": "6s"}, a_stream("b")],
        tasks=[a_task("t0", activity=[{"when": "a.p || b.p"}])],
        edits=[(3, {"streams": [STALE | {"staleAfter": "4s"}, a_stream("b")]})],
        remembered={"t0": Memory(3.0, suspended=False)},
    ),
    "an event that reads nothing ended": story(
        streams=[a_stream("a")], tasks=[a_task("t0", activity=[{"when": "true", "hold": "2s"}]), a_task("t1")]
    ),
}


@pytest.mark.parametrize("name", STORIES)
def test_planner_and_model_agree_on_past_differences(name):
    assert difference(STORIES[name]) is None
