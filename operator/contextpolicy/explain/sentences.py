"""Turns an explanation into sentences."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

from contextpolicy.planning.allocation.enforcement import PROTECTED_WEIGHT
from contextpolicy.policy.spec import Control, Scheduler

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

LONGEST_VALUE = 120

_PUBLISHED = "stamp"
"""The field that robotkit and the player of timelines add to an object: when it was published, no sensor's reading."""


def sentences(explanation: Mapping[str, Any], task: str) -> list[str]:
    """Why `task` has its share; KeyError for a task that the explanation does not have."""
    if explanation["plan"] is None:
        return ["There is no plan yet: no event has required one."]
    own = explanation["tasks"][task]
    return [
        *_headline(explanation, task, own),
        *_score(own),
        *_preconditions(own),
        *_weight(own),
        *_idle_contexts(explanation, own),
        *_graph(own, task),
        *_division(explanation, task),
        *_needs(own),
        *_readings(explanation, own),
    ]


def context_sentences(explanation: Mapping[str, Any]) -> list[str]:
    """For each context, whether it holds and why."""
    return [_context(name, context) for name, context in explanation["contexts"].items()]


def _context(name: str, context: Mapping[str, Any]) -> str:
    if context["insisted"]:
        return f"Context {name} holds: {' and '.join(context['insisted'])}."
    if context["when"] is None:
        return f"Context {name} does not hold: it has no condition, and is neither forced nor needed as the fallback."
    parts = _parts(context["decidedBy"])
    if context["turnsIn"] is None and context["holds"] and context["until"]:
        return f"Context {name} holds until `{context['until']}`: {_parts(context['decidedBy'], context['until'])}."
    if context["turnsIn"] is None:
        return f"Context {name} {'holds' if context['holds'] else 'does not hold'}: {parts}."
    if context["holds"]:
        return f"Context {name} still holds, for {context['turnsIn']:.3g} s more (exitAfter): {parts}."
    return f"Context {name} will hold in {context['turnsIn']:.3g} s (enterAfter): {parts}."


def _idle_contexts(explanation: Mapping[str, Any], own: Mapping[str, Any]) -> Iterator[str]:
    """The contexts that would change the task, but do not hold."""
    for name in own["contexts"]:
        context = explanation["contexts"][name]
        if not context["active"]:
            yield _context(name, context)


def _parts(parts: Sequence[Mapping[str, Any]], quoted: str | None = None) -> str:
    """The parts of an expression that decide; `quoted` is an expression that the sentence has quoted already."""
    return " and ".join(
        _part(part, "it" if part["expression"] == quoted else f"`{part['expression']}`") for part in parts
    )


def _part(part: Mapping[str, Any], name: str) -> str:
    """The value of a part of an expression, and its operands' values."""
    if part.get("waitsFor"):
        return f"{name} waits for {_absent(part['waitsFor'])}"
    if part["value"] is None:
        return f"{name} has no value: {part['error']}" if "error" in part else f"{name} is null"
    where = " and ".join(f"`{operand}` is {_shown(value)}" for operand, value in part["operands"].items())
    return f"{name} is {_shown(part['value'])}{', for ' if where else ''}{where}"


def _absent(absence: Mapping[str, Any]) -> str:
    if "reason" in absence:
        return f"stream {absence['stream']}: for {absence['for']:.3g} s {absence['reason']}"
    state = "silent for" if absence["heard"] else "never heard in"
    return f"stream {absence['stream']}, {state} {absence['for']:.3g} s"


def _headline(explanation: Mapping[str, Any], task: str, own: Mapping[str, Any]) -> Iterator[str]:
    plan = explanation["plan"]
    nodes = {name: node for name, node in explanation["nodes"].items() if task in node["tasks"]}
    shares = " and ".join(f"{_cpu(node['tasks'][task]['share'])} on node {n}" for n, node in nodes.items())
    suspended = ", the minimum: it is suspended" if own["suspended"] and nodes else ""
    yield f"{task} gets {shares}{suspended}." if nodes else f"{_shareless(explanation, task, own)}."
    yield f"Plan {plan['sequence']} has been in force for {plan['age']:.3g} s, caused by {plan['cause']}."
    fair = [node["tasks"][task] for node in nodes.values() if node["scheduler"] == Scheduler.CFS]
    if fair and not own["suspended"]:
        yield from _enforced(explanation["control"], own, min(row["share"] for row in fair))


def _enforced(control: str, own: Mapping[str, Any], share: int) -> Iterator[str]:
    """What a share means for a running task where it is not a cap."""
    if control == Control.SUSPEND:
        yield "That is informative only: control Suspend leaves a running task its original limit, up to its max."
    if control == Control.WEIGHT:
        yield "That is its weight where CPU is contested (control Weight); it may also use what others leave idle."
        if own["protected"] and share < PROTECTED_WEIGHT:
            yield (
                f"It is protected, so beside the other tasks its weight is {_cpu(PROTECTED_WEIGHT)}: "
                "small weights wait long."
            )


def _shareless(explanation: Mapping[str, Any], task: str, own: Mapping[str, Any]) -> str:
    if own["subtasks"]:
        return f"{task} has no container of its own"
    kept = [shortfall["message"] for shortfall in explanation["plan"]["shortfalls"] if not shortfall["task"]]
    return f"{task} has no share: {'; '.join(kept) or 'none of its containers runs on a node that is divided'}"


def _score(own: Mapping[str, Any]) -> Iterator[str]:
    fresh = [activity for activity in own["activity"] if activity["value"] > 0]
    for activity in fresh:
        strongest = " (the strongest)" if len(fresh) > 1 and activity["value"] == own["score"] else ""
        yield f"Activity {_named(activity)} {_state(activity)}{strongest}{_until(activity)}."
    if fresh and own["score"] > max(activity["value"] for activity in fresh):
        yield f"Its idle score, {own['idle']:g}, is higher."
    if fresh:
        return
    for activity in own["activity"]:
        yield f"Activity {_named(activity)} is not in force{_because(activity)}."
    if own["idle"] is not None:
        yield f"Its score is its idle score, {own['idle']:g}."
    else:
        yield f"Its score is {own['score']:g}{'' if own['activity'] else ', as for every task without activity'}."


def _because(activity: Mapping[str, Any]) -> str:
    if activity["initiative"]:
        return ""
    if activity["absent"]:
        return f": it waits for {_absent(activity['absent'])}"
    if activity["scoreFrom"] and activity["matches"]:
        return f": {_parts(activity['scoreDecidedBy'])}"
    return f": {_parts(activity['decidedBy'], activity['when'])}"


def _state(activity: Mapping[str, Any]) -> str:
    if activity["decaysFrom"] is None:
        return f"is in force with score {activity['value']:g}"
    return f"is over: its score has decayed from {activity['decaysFrom']:g} to {activity['value']:g}"


def _until(activity: Mapping[str, Any]) -> str:
    return f" until `{activity['until']}`" if activity["until"] and activity["decaysFrom"] is None else ""


def _named(activity: Mapping[str, Any]) -> str:
    if activity["initiative"]:
        return f"of initiative {activity['initiative']}"
    streams = f" on {', '.join(activity['streams'])}" if activity["streams"] else ""
    return f"`{activity['when']}`{streams}"


def _preconditions(own: Mapping[str, Any]) -> Iterator[str]:
    for requirement in own["requires"]:
        state = "holds" if requirement["met"] else "does not hold, so it waits with weight 0"
        why = "" if requirement["met"] else f": {_parts(requirement['decidedBy'], requirement['when'])}"
        yield f"Its pre-condition `{requirement['when']}` {state}{why}."
    for required, able in own["requiredTasks"].items():
        yield f"It requires task {required}, which {'can run' if able else 'cannot run, so it waits with weight 0'}."


def _weight(own: Mapping[str, Any]) -> Iterator[str]:
    product = own["priority"] * own["score"]
    yield f"Priority {own['priority']:g} times score {own['score']:g} is {product:g}."
    for effect in own["effects"]:
        overruled = "" if effect["decides"] else ", but another context decides"
        ruled_out = ", which has no effect: it is protected" if effect["ruledOut"] else overruled
        yield f"Context {effect['context']} {effect['change']}{ruled_out}."
    if own["weight"] != product:
        because = "" if own["effects"] else f": {own['because']}"
        yield f"So its weight is {own['weight']:.4g}{because}."


def _graph(own: Mapping[str, Any], task: str) -> Iterator[str]:
    if own["parent"]:
        yield f"It is a subtask of {own['parent']}, whose weight is split over the subtasks that can run."
    if own["subtasks"]:
        kind = "compound: it needs all of" if own["satisfiedBy"] == "All" else "complex: it needs any of"
        yield f"{task} is {kind} {', '.join(own['subtasks'])}; the share is theirs."


def _division(explanation: Mapping[str, Any], task: str) -> Iterator[str]:
    for name, node in explanation["nodes"].items():
        row = node["tasks"].get(task)
        if row is None:
            continue
        if not node["current"]:
            yield f"The plan in force on node {name} is an older one: the next waits until minDwell is over."
            continue
        if node["dividedBy"] == "Priority":
            yield f"Nothing on node {name} is active: the tasks that can run divide it by priority."
        if node["dividedBy"] == "Nothing":
            yield f"No task on node {name} can run: each gets the minimum."
        if row["weight"] > 0:
            equation = "Eq. 1" if node["scheduler"] == Scheduler.CFS else "Eq. 2"
            part = f"{_cpu(node['capacity'])} * {row['weight']:.4g} / {node['weights']:.4g}"
            yield f"{equation} on node {name}: {part} = {_cpu(row['proportional'])}."
        yield from _bounds(node, row, task)


def _bounds(node: Mapping[str, Any], row: Mapping[str, Any], task: str) -> Iterator[str]:
    if node["floorsExceed"]:
        yield "The floors together exceed the node, so all are scaled down."
    elif row["bound"] and row["weight"] > 0:
        word = "raises it to" if row["bound"] == "floor" else "holds it at"
        yield f"Its {row['bound']} {word} {_cpu(row['share'])}."
    elif row["weight"] > 0 and abs(row["share"] - row["proportional"]) >= node["step"]:
        held = ", ".join(_held(node, task))
        yield f"{held}; the rest, divided by weight, gives it {_cpu(row['share'])}."
    elif row["weight"] > 0 and row["share"] != row["proportional"]:
        yield f"Rounded to steps of {_cpu(node['step'])}, its share is {_cpu(row['share'])}."


def _held(node: Mapping[str, Any], task: str) -> Iterator[str]:
    """The other tasks whose share a bound or a suspension fixes."""
    for name, row in node["tasks"].items():
        if name != task and (row["bound"] or row["weight"] == 0):
            why = "suspended" if row["weight"] == 0 else f"at its {row['bound']}"
            yield f"{name} has {_cpu(row['share'])} ({why})"


def _needs(own: Mapping[str, Any]) -> Iterator[str]:
    for need in own["needs"]:
        verdict = "met" if need["met"] else "not required while suspended" if own["suspended"] else "not met"
        yield f"It needs {_need(need)}: {verdict}."
    yield from (f"Not feasible: it {message}." for message in own["shortfalls"] if not message.startswith("needs "))


def _need(need: Mapping[str, Any]) -> str:
    wanted, given = need["wanted"], need["given"]
    match need["need"]:
        case "cores":
            return f"{wanted}m of CPU and gets {given}m"
        case "memory":
            limit = "has no limit" if given is None else f"has a limit of {_mebibytes(given)}"
            return f"{_mebibytes(wanted)} of memory and {limit}"
        case _:
            return f"results within {wanted:g} s and may stall for {given:.3g} s"


def _mebibytes(count: int) -> str:
    return f"{count / 2**20:.4g}Mi"


def _readings(explanation: Mapping[str, Any], own: Mapping[str, Any]) -> Iterator[str]:
    """The last samples of the streams that the task and the contexts in force on it read."""
    contexts = [explanation["contexts"][effect["context"]] for effect in own["effects"]]
    readers = [*own["activity"], *own["requires"], *contexts]
    for name in dict.fromkeys(stream for reader in readers for stream in reader["streams"]):
        stream = explanation["streams"][name]
        if stream["age"] is None:
            yield f"Stream {name} ({stream['key']}) has not been heard."
            continue
        silent = ", silent for too long, so its value does not count" if stream["silent"] else ""
        value = _shown(_fields(stream, [reader for reader in readers if name in reader["streams"]]))
        yield f"Stream {name}: heard {stream['age']:.3g} s ago{silent}; last value {value}."


def _fields(stream: Mapping[str, Any], readers: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A stream's value; when it was published only if a reader's expression has that field."""
    fields = dict(stream["value"] or {})
    expressions = (reader.get(name) or "" for reader in readers for name in ("when", "until", "scoreFrom"))
    if not any(re.search(rf"\b{_PUBLISHED}\b", one) for one in expressions):
        fields.pop(_PUBLISHED, None)
    return {**fields, **stream["features"]}


def _shown(value: object) -> str:
    text = f"{value:.6g}" if isinstance(value, float) else json.dumps(value, default=str)
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."


def _cpu(millis: float) -> str:
    return f"{round(millis, 1):g}m"
