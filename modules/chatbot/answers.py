"""Rules from questions to answers: the first rule whose pattern matches answers. Pure: time is an argument."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from modules.chatbot.memory import Memory, Pause, TaskRecord

    Rule = Callable[[re.Match[str], Memory, float], str]

STALE_S = 5.0
"""A pose or health message older than this says nothing about the present."""

ACTIVITIES = {
    "listen": ("speech", "keyword-spotting", "transcript", "microphone"),
    "hear": ("speech", "keyword-spotting", "transcript", "microphone"),
    "talk": ("voice", "chatbot"),
    "speak": ("voice", "chatbot"),
    "look": ("camera", "signs"),
    "see": ("camera", "signs"),
    "read": ("signs",),
    "map": ("slam",),
    "localis": ("slam",),
    "localiz": ("slam",),
    "driv": ("navigation",),
    "mov": ("navigation",),
    "navigat": ("navigation",),
    "grasp": ("arm",),
    "grab": ("arm",),
}
"""The tasks that do what a verb says, by the beginning of the verb; a task's own name always means itself."""


def answer(question: str, memory: Memory, now: float) -> str:
    """The robot's answer to a question."""
    words = " ".join(re.findall(r"[a-z0-9'-]+", question.lower()))
    for pattern, rule in RULES:
        match = re.search(pattern, words)
        if match is not None:
            return rule(match, memory, now)
    return f'I did not understand "{words}". {_help()}'


def _where(_: re.Match[str], memory: Memory, now: float) -> str:
    place = memory.place
    if place is None:
        return "I do not know where I am: I have received no position yet."
    x, y, z = place.position
    spot = f"at x {x:.1f}, y {y:.1f}, z {z:.1f} metres from where I started, {math.hypot(x, y, z):.1f} metres away"
    if not place.known:
        return f"I have lost my way. My last guess is {spot}."
    if now - place.at > STALE_S:
        return f"I was {spot}, but that was {_duration(now - place.at)} ago."
    return f"I am {spot}."


def _what(_: re.Match[str], memory: Memory, now: float) -> str:
    del now
    if not memory.tasks:
        return "I do not know: I have received no plan yet."
    busy = sorted(
        (item for item in memory.tasks.items() if not item[1].suspended), key=lambda item: item[1].share, reverse=True
    )
    paused = sorted(name for name, task in memory.tasks.items() if task.suspended)
    parts = [f"{name} with {task.share:.2f} cores" for name, task in busy]
    context = f"Context {_listed(memory.contexts)}: " if memory.contexts else ""
    running = f"{context}I run {_listed(parts)}." if parts else f"{context}I rest."
    return f"{running} Paused: {_listed(paused)}." if paused else running


def _why(match: re.Match[str], memory: Memory, now: float) -> str:
    names = _tasks_of(match["activity"], memory)
    if not names:
        known = f"I know {_listed(sorted(memory.tasks))}." if memory.tasks else "I have received no plan yet."
        return f'I have no task for "{match["activity"]}". {known}'
    name, task = max(((name, memory.tasks[name]) for name in names), key=_last_paused)
    if task.pause is None:
        return f"I did not stop: {name} has {task.share:.2f} cores, {task.because or 'by the policy'}."
    return _paused(name, task.pause, now)


def _paused(name: str, pause: Pause, now: float) -> str:
    reason = pause.because or pause.cause or "the policy says so"
    trigger = f" It began with: {pause.cause}." if pause.cause and pause.cause != reason else ""
    if pause.end is None:
        return f"{name} has been paused for {_duration(now - pause.start)}, because {reason}.{trigger}"
    span = f"from {_duration(now - pause.start)} ago until {_duration(now - pause.end)} ago"
    return f"{name} was paused {span}, because {reason}.{trigger}"


def _how(_: re.Match[str], memory: Memory, now: float) -> str:
    fresh = {name: misses for name, (at, misses) in memory.misses.items() if now - at <= STALE_S}
    if not fresh:
        return "I do not know: none of my tasks has said how it fares."
    late = [f"{name} is late with {misses:.0%} of its work" for name, misses in sorted(fresh.items()) if misses > 0]
    return f"Not so well: {_listed(late)}." if late else f"I am well: {_listed(sorted(fresh))} are on time."


def _can(*_: object) -> str:
    return _help()


def _help() -> str:
    return "Ask me where I am, what I am doing, how I am, or why I stopped something, such as listening."


_ASKS_WHY = r"\bwhy (did|do|are|were|have|has|is|was)\b"
_IDLE = r"(stop|stopped|not|pause|paused|slow|suspended)\b"
RULES: tuple[tuple[str, Rule], ...] = (
    (r"\bwhere\b.*\byou\b|\byour (place|position|location)\b", _where),
    (rf"{_ASKS_WHY}.*?\b{_IDLE} (the )?(?P<activity>[a-z-]+)", _why),
    (rf"{_ASKS_WHY} (you |the )*(?P<activity>[a-z-]+) {_IDLE}", _why),
    (r"\bwhat\b.*\b(doing|do you do|up to)\b", _what),
    (r"\bhow are you\b|\bhow do you (do|feel)\b|\bare you (well|okay|all right|alright)\b", _how),
    (r"\bhelp\b|\bwhat can you\b", _can),
)


def _tasks_of(activity: str, memory: Memory) -> list[str]:
    if activity in memory.tasks:
        return [activity]
    named = next((tasks for verb, tasks in ACTIVITIES.items() if activity.startswith(verb)), ())
    return [name for name in named if name in memory.tasks]


def _last_paused(item: tuple[str, TaskRecord]) -> float:
    return item[1].pause.start if item[1].pause else -math.inf


def _duration(seconds: float) -> str:
    whole = max(round(seconds), 0)
    if whole < 120:
        return f"{whole} second{'' if whole == 1 else 's'}"
    return f"{round(whole / 60)} minutes"


def _listed(names: list[str]) -> str:
    def parts() -> Iterator[str]:
        yield ", ".join(names[:-1])
        yield names[-1]

    return names[0] if len(names) == 1 else " and ".join(parts())
