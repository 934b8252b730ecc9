"""A ContextPolicy object as read from YAML or the API -> a valid `Policy`, or every finding at once."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from typing import TYPE_CHECKING, Any

from contextpolicy.errors import PolicyError
from contextpolicy.policy import bandwidth, references
from contextpolicy.policy import spec as policy
from contextpolicy.policy.fields import LARGEST_WEIGHT, MOST_FINDINGS, OBJECT_NAME, TASK_NAME, TASK_NAME_ALLOWED, Fields
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
    result = policy.Policy(
        namespace=namespace,
        name=name,
        mode=spec.choice("mode", policy.Mode.ENFORCE),
        enforcement=_enforcement(spec.nested("enforcement")),
        reserve=spec.cpu("reserve") or 0,
        fallback=spec.optional_text("fallback"),
        force=_force(spec.nested("force")) if "force" in spec else spec.raw("force"),
        shadow=_shadow(spec.nested("shadow"), name) if "shadow" in spec else spec.raw("shadow"),
        streams=tuple(parse_stream(item) for item in spec.nested_list("streams", limit=64)),
        tasks=tuple(parse_task(item) for item in spec.nested_list("tasks", limit=128)),
        contexts=tuple(_context(item) for item in spec.nested_list("contexts", limit=64)),
    )
    if not result.tasks:
        spec.refuse("tasks", spec.raw("tasks"), "at least one task")
    spec.close()
    return result


def _enforcement(fields: Fields) -> policy.Enforcement:
    result = policy.Enforcement(
        control=fields.choice("control", policy.Control.WEIGHT),
        scheduler=fields.choice("scheduler", policy.Scheduler.CFS),
        transition=fields.choice("transition", policy.Transition.PROMPT),
        min_dwell=fields.duration("minDwell") or 0.0,
        period=_period(fields),
        realtime_fallback=fields.choice("realtimeFallback", policy.RealtimeFallback.CFS),
        realtime_policy=fields.choice("realtimePolicy", policy.RealtimePolicy.RR),
    )
    fields.close()
    return result


def _period(fields: Fields) -> float:
    period = fields.duration("period")
    if period is None:
        return bandwidth.PERIOD
    if not bandwidth.SHORTEST <= period <= bandwidth.LONGEST:
        fields.refuse("period", fields.raw("period"), "a duration from 10ms to 1s, which kernels support")
    return period


def _force(fields: Fields) -> policy.Force:
    result = policy.Force(fields.text("context"), fields.moment("until"))
    fields.close()
    return result


def _shadow(fields: Fields, own: str) -> policy.Shadow:
    usual = policy.Shadow("")
    tolerance, patience = fields.number("tolerance", most=1), fields.duration("patience")
    result = policy.Shadow(
        of=fields.text("of", pattern=OBJECT_NAME, allowed="the name of another policy of the namespace"),
        tolerance=usual.tolerance if tolerance is None else tolerance,
        patience=usual.patience if patience is None else patience,
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
    result = policy.Context(
        name=fields.text("name", pattern=TASK_NAME, allowed=TASK_NAME_ALLOWED),
        when=fields.cel("when"),
        until=fields.cel("until"),
        enter_after=fields.duration("enterAfter") or 0.0,
        exit_after=fields.duration("exitAfter") or 0.0,
        effects={task: _effect(item) for task, item in fields.mapping("tasks", limit=128).items()},
    )
    if "until" in fields and "when" not in fields:
        fields.refuse("when", None, "a CEL condition, as until only ends what when begins")
    fields.close()
    return result


def _effect(fields: Fields) -> policy.Effect:
    suspend = fields.flag("suspend") if "suspend" in fields else None
    result = policy.Effect(
        fields.number("weight", most=LARGEST_WEIGHT),
        fields.number("scale", most=LARGEST_WEIGHT),
        suspend,
        min=fields.cpu("min"),
        max=fields.cpu("max"),
    )
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
