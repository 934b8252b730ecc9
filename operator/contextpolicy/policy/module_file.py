"""A module.yaml, which lists a module's inputs, outputs and needs; modules/robotkit describes the format."""

from __future__ import annotations

from dataclasses import dataclass

from contextpolicy.errors import Finding, FindingsError
from contextpolicy.policy.fields import TASK_NAME, TASK_NAME_ALLOWED, Fields
from contextpolicy.policy.quantities import format_cpu
from contextpolicy.policy.stream_spec import Encoding


class ModuleFileError(FindingsError):
    """A module.yaml that breaks rules."""


@dataclass(frozen=True, slots=True)
class ModuleStream:
    """An input or output of a module; `encoding` is None where a policy can't read it, as with pictures."""

    key: str
    encoding: Encoding | None
    type: str | None


@dataclass(frozen=True, slots=True)
class ModuleFile:
    """One module; its needs are kept as a policy writes them."""

    name: str
    description: str
    inputs: tuple[ModuleStream, ...]
    outputs: tuple[ModuleStream, ...]
    needs: dict[str, object]


def parse_module(body: object, *, subject: str) -> ModuleFile:
    """Read a module.yaml's content; ModuleFileError carries every finding."""
    findings: list[Finding] = []
    fields = Fields(body, "module", findings)
    module = ModuleFile(
        name=fields.text("name", pattern=TASK_NAME, allowed=TASK_NAME_ALLOWED),
        description=fields.text("description", ""),
        inputs=tuple(_stream(entry, *_INPUT) for entry in fields.mapping("inputs", limit=64).values()),
        outputs=tuple(_stream(entry, *_OUTPUT) for entry in fields.mapping("outputs", limit=64).values()),
        needs=_needs(fields.nested("needs")),
    )
    fields.string_map("environment")
    fields.close()
    if findings:
        raise ModuleFileError(subject, tuple(findings))
    return module


_INPUT = ("depth", "ros", "types")
_OUTPUT = ("frame", "kind", "child_frame", "ros", "types")
"""Fields that only the module itself reads."""


def _stream(fields: Fields, *further: str) -> ModuleStream:
    encoding = fields.text("encoding", "json", allowed="an encoding such as json")
    stream = ModuleStream(
        key=fields.key_expression("key"),
        encoding=Encoding(encoding) if encoding in list(Encoding) else None,
        type=fields.optional_text("type"),
    )
    for name in further:
        fields.raw(name)
    fields.close()
    return stream


def _needs(fields: Fields) -> dict[str, object]:
    values = {"cores": fields.cpu("cores"), "memory": fields.memory("memory"), "deadline": fields.duration("deadline")}
    needs = {name: fields.raw(name) for name, value in values.items() if value is not None}
    if values["cores"] is not None:
        needs["cores"] = format_cpu(int(values["cores"]))  # the API refuses a bare fraction
    fields.close()
    return needs
