"""A ContextPolicy object as read from YAML or the API -> a valid `Policy`, or every finding at once."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from typing import TYPE_CHECKING, Any

from contextpolicy.errors import PolicyError
from contextpolicy.policy import bandwidth, references
from contextpolicy.policy import spec as policy
from contextpolicy.policy.field_types import value_of
from contextpolicy.policy.fields import MOST_FINDINGS, OBJECT_NAME, TASK_NAME, TASK_NAME_ALLOWED, Fields
from contextpolicy.policy.stream_parsing import parse_stream
from contextpolicy.policy.task_parsing import parse_task

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from contextpolicy.errors import Finding


def parse(body: Mapping[str, Any], *checks: Callable[[policy.Policy], Iterable[Finding]]) -> policy.Policy:
    """Read a whole object; PolicyError carries every finding, including those of `checks` on the parsed policy."""
    findings: list[Finding] = []
    fields = body if isinstance(body, dict) else dict(body) if isinstance(body, Mapping) else {}
    metadata = Fields(fields.get("metadata"), "metadata", findings)
    namespace, name = (
        metadata.text("namespace", "default", allowed="a namespace"),
        metadata.text("name", allowed="a name"),
    )
    result = _policy(namespace, name, Fields(fields.get("spec"), "spec", findings))
    # Run them even after findings: what was refused has a harmless default, and all mistakes are reported at once.
    for check in (references.check, *checks):
        findings += islice(check(result), MOST_FINDINGS - len(findings))
    if findings:
        raise PolicyError(f"ContextPolicy {namespace}/{name}", tuple(findings))
    return result


def _policy(namespace: str, name: str, spec: Fields) -> policy.Policy:
    result = value_of(
        policy.Policy,
        spec,
        namespace=namespace,
        name=name,
        enforcement=_enforcement(spec.nested("enforcement")),
        force=_force(spec.nested("force")) if "force" in spec else spec.raw("force"),
        shadow=_shadow(spec.nested("shadow"), name) if "shadow" in spec else spec.raw("shadow"),
        streams=tuple(parse_stream(item) for item in spec.nested_list("streams", limit=64)),
        tasks=tuple(parse_task(item) for item in spec.nested_list("tasks", limit=128)),
        contexts=tuple(_context(item) for item in spec.nested_list("contexts", limit=64)),
    )
    if spec.raw("tasks") in (None, []):
        spec.refuse("tasks", spec.raw("tasks"), "at least one task")
    spec.close()
    return result


def _enforcement(fields: Fields) -> policy.Enforcement:
    result = value_of(policy.Enforcement, fields)
    if not bandwidth.SHORTEST <= result.period <= bandwidth.LONGEST:
        fields.refuse("period", fields.raw("period"), "a duration from 10ms to 1s, which kernels support")
    fields.close()
    return result


def _force(fields: Fields) -> policy.Force:
    result = policy.Force(fields.text("context"), fields.moment("until"))
    fields.close()
    return result


def _shadow(fields: Fields, own: str) -> policy.Shadow:
    usual = policy.Shadow("")
    tolerance = fields.number("tolerance", most=1)
    result = value_of(
        policy.Shadow,
        fields,
        of=fields.text("of", pattern=OBJECT_NAME, allowed="the name of another policy of the namespace"),
        tolerance=usual.tolerance if tolerance is None else tolerance,
        health=fields.key_expression("health") if "health" in fields else usual.health,
    )
    if result.of == own:
        fields.refuse("of", result.of, "the name of another policy of the namespace")
    if result.patience == 0:
        fields.refuse("patience", fields.raw("patience"), "a duration above 0")
    if result.health and result.health.count("*") != 1:
        fields.refuse("health", result.health, "a key expression with one *, in place of the task's name")
    fields.close()
    return result


def _context(fields: Fields) -> policy.Context:
    result = value_of(
        policy.Context,
        fields,
        name=fields.text("name", pattern=TASK_NAME, allowed=TASK_NAME_ALLOWED),
        effects={task: _effect(item) for task, item in fields.mapping("tasks", limit=128).items()},
    )
    if "until" in fields and "when" not in fields:
        fields.refuse("when", None, "a CEL condition, which until requires")
    fields.close()
    return result


def _effect(fields: Fields) -> policy.Effect:
    suspend = fields.flag("suspend") if "suspend" in fields else None
    result = value_of(policy.Effect, fields, suspend=suspend)
    changes = ["weight" in fields, "scale" in fields, result.suspend is True].count(True)
    bounded = "min" in fields or "max" in fields
    if changes > 1 or (not changes and result.suspend is None and not bounded):
        fields.refuse(
            "",
            {name: fields.raw(name) for name in ("weight", "scale", "suspend") if name in fields},
            "exactly one of weight, scale and suspend; only suspend: false may accompany another, and min and max may "
            "stand alone",
        )
    if suspend is False and result.suspends:
        fields.refuse("suspend", suspend, "suspend: false only with a weight or scale above 0: 0 suspends the task")
    fields.close()
    return result
