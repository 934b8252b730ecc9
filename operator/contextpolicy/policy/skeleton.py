"""Modules -> a first policy for a robot that runs them: valid as it is, and meant to be edited.

Each module becomes a task with its needs, and each stream that it can read an activity. The health of a task with a
deadline is a stream, and a context gives it more while it misses deadlines. What can't be known is left as a comment.
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

from contextpolicy.policy.cel_functions import RESERVED
from contextpolicy.policy.custom_resource import API_VERSION

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from contextpolicy.policy.module_file import ModuleFile, ModuleStream

HEALTH = "robot/{task}/health"
_PLAIN = re.compile(r"[A-Za-z0-9_./*][A-Za-z0-9_./*-]*")


def skeleton(modules: Sequence[ModuleFile], *, name: str, namespace: str) -> str:
    """The policy as YAML."""
    names = _names(modules)
    contexts = [line for module in modules for line in _starves(module, names)]
    lines = [
        f"# What runs on the robot: {', '.join(module.name for module in modules)}. Edit it.",
        f"apiVersion: {API_VERSION}",
        "kind: ContextPolicy",
        "metadata:",
        f"  name: {name}",
        f"  namespace: {namespace}",
        "spec:",
        "  mode: DryRun                         # only plans and reports; Enforce also acts",
        "  # enforcement: {control: Suspend}    # the first step: contexts only suspend (default: Weight)",
        "  streams:",
        *_streams(modules, names),
        "  tasks:",
        *(line for module in modules for line in _task(module, names)),
        *(["  contexts:", *contexts] if contexts else []),
    ]
    return "\n".join(lines) + "\n"


def _names(modules: Sequence[ModuleFile]) -> dict[str, str]:
    """A stream name for every key: for health the task's name, for others the key without its first part."""
    names: dict[str, str] = {}
    taken = set(RESERVED)
    keys = [HEALTH.format(task=module.name) for module in modules]
    keys += [stream.key for module in modules for stream in (*_readable(module), *module.outputs) if stream.encoding]
    suggestions = [(key, module.name) for key, module in zip(keys, modules, strict=False)]
    suggestions += [(key, key.partition("/")[2] or key) for key in keys[len(modules) :]]
    for key, suggestion in suggestions:
        if key in names:
            continue
        base = re.sub(r"[^a-z0-9]+", "_", suggestion.lower()).strip("_")[:50] or "stream"
        base = base if base[0].isalpha() else f"stream_{base}"
        free = (base, *(f"{base}_{number}" for number in range(2, len(suggestions) + len(RESERVED) + 2)))
        names[key] = next(one for one in free if one not in taken)
        taken.add(names[key])
    return names


def _streams(modules: Sequence[ModuleFile], names: dict[str, str]) -> Iterator[str]:
    makers = {stream.key: module.name for module in modules for stream in module.outputs}
    taken = {stream.key: stream for module in modules for stream in _readable(module)}
    for module in modules:
        if "deadline" in module.needs:
            key = HEALTH.format(task=module.name)
            yield f"  - {{name: {names[key]}, key: {key}, producedBy: {module.name}}}"
    for key, stream in taken.items():
        yield f"  - {_stream(stream, names[key], makers.get(key))}"
    for module in modules:
        for stream in module.outputs:
            if stream.encoding and stream.key not in taken:
                yield f"  # - {_stream(stream, names[stream.key], module.name)}    # nothing reads it yet"


def _readable(module: ModuleFile) -> list[ModuleStream]:
    """The inputs that a policy can read too, except what the operator itself publishes."""
    return [one for one in module.inputs if one.encoding and not one.key.startswith("contextpolicy/")]


def _stream(stream: ModuleStream, name: str, maker: str | None) -> str:
    fields = {"name": name, "key": stream.key, "encoding": stream.encoding, "type": stream.type, "producedBy": maker}
    said = {field: str(value) for field, value in fields.items() if value and value != "json"}
    return "{" + ", ".join(f"{field}: {_text(value)}" for field, value in said.items()) + "}"


def _task(module: ModuleFile, names: dict[str, str]) -> Iterator[str]:
    yield f"  - name: {module.name}" + (f"    # {_comment(module.description)}" if module.description else "")
    yield f"    selector: {{matchLabels: {{app: {module.name}}}}}"
    yield "    priority: 1"
    if module.needs:
        yield "    needs: {" + ", ".join(f"{name}: {_text(str(value))}" for name, value in module.needs.items()) + "}"
    readable = [names[stream.key] for stream in _readable(module)]
    if readable:
        yield "    idle: 0.1"
        yield "    activity:"
        yield from (f"    - {{stream: {name}, hold: 2s}}" for name in dict.fromkeys(readable))
    else:
        yield "    # activity: [{stream: ..., when: ..., hold: 2s}]    # the samples that make it matter"


def _starves(module: ModuleFile, names: dict[str, str]) -> Iterator[str]:
    if "deadline" in module.needs:
        health = names[HEALTH.format(task=module.name)]
        yield f"  - name: {module.name}-starves"
        yield f"    when: {health}.misses > 0.1"
        yield "    enterAfter: 2s"
        yield "    exitAfter: 5s"
        yield "    tasks:"
        yield f"      {module.name}: {{scale: 2}}"


def _text(value: str) -> str:
    """A YAML scalar; quoted where it could be read as something else."""
    return value if _PLAIN.fullmatch(value) and not value.startswith("*") else json.dumps(value)


def _comment(text: str) -> str:
    return " ".join(text.split())
