"""A ContextPolicy object as read from YAML or the API -> a valid `Policy`, or every finding at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from contextpolicy.errors import PolicyError
from contextpolicy.policy import bandwidth, references
from contextpolicy.policy import spec as policy
from contextpolicy.policy.fields import (
    FEATURE_NAME,
    FEATURE_NAME_ALLOWED,
    FIELD_PATH,
    OBJECT_NAME,
    ROS_TYPE,
    STREAM_NAME,
    STREAM_NAME_ALLOWED,
    TASK_NAME,
    TASK_NAME_ALLOWED,
    Fields,
)
from contextpolicy.policy.selectors import (
    LABEL_KEY_ALLOWED,
    LABEL_VALUE_ALLOWED,
    OPERATORS,
    Selector,
    SelectorRequirement,
    is_label_key,
    is_label_value,
)

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
        findings += check(result)
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
        streams=tuple(_stream(item) for item in spec.nested_list("streams", limit=64)),
        tasks=tuple(_task(item) for item in spec.nested_list("tasks", limit=128)),
        contexts=tuple(_context(item) for item in spec.nested_list("contexts", limit=64)),
    )
    if not result.tasks:
        spec.refuse("tasks", spec.raw("tasks"), "at least one task")
    spec.close()
    return result


def _enforcement(fields: Fields) -> policy.Enforcement:
    result = policy.Enforcement(
        control=fields.choice("control", policy.Control.LIMIT),
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
        fields.refuse("period", fields.raw("period"), "10ms to 1s, what the kernel can measure")
    return period


def _force(fields: Fields) -> policy.Force:
    result = policy.Force(fields.text("context"), fields.moment("until"))
    fields.close()
    return result


def _shadow(fields: Fields, own: str) -> policy.Shadow:
    usual = policy.Shadow("")
    tolerance, patience = fields.number("tolerance"), fields.duration("patience")
    result = policy.Shadow(
        of=fields.text("of", pattern=OBJECT_NAME, allowed="the name of another policy of the namespace"),
        tolerance=usual.tolerance if tolerance is None else tolerance,
        patience=usual.patience if patience is None else patience,
        health=fields.key_expression("health") if "health" in fields else usual.health,
    )
    if result.of == own:
        fields.refuse("of", result.of, "the name of another policy of the namespace")
    if result.tolerance > 1:
        fields.refuse("tolerance", result.tolerance, "a part of the inputs: 0 to 1")
    if result.patience == 0:
        fields.refuse("patience", fields.raw("patience"), "a duration above 0")
    if result.health and result.health.count("*") != 1:
        fields.refuse("health", result.health, "a key expression with one *, where the task's name is")
    fields.close()
    return result


def _stream(fields: Fields) -> policy.Stream:
    result = policy.Stream(
        name=fields.text("name", pattern=STREAM_NAME, allowed=STREAM_NAME_ALLOWED),
        key=fields.key_expression("key"),
        encoding=fields.choice("encoding", policy.Encoding.JSON),
        type=fields.optional_text("type", pattern=ROS_TYPE, allowed="a ROS 2 type such as sensor_msgs/msg/Imu"),
        ros=fields.choice("ros", policy.RosRelease.LATEST),
        types=fields.optional_text("types", pattern=OBJECT_NAME, allowed="the name of a ConfigMap"),
        stale_after=fields.duration("staleAfter"),
        liveliness=fields.key_expression("liveliness") if "liveliness" in fields else fields.raw("liveliness"),
        timestamp=fields.optional_text("timestamp", pattern=FIELD_PATH, allowed="a field path such as header.stamp"),
        clock=fields.choice("clock", policy.Clock.AUTO),
        filter=fields.cel("filter"),
        debounce=fields.duration("debounce") or 0.0,
        sample_every=fields.duration("sampleEvery") or 0.0,
        produced_by=fields.optional_text("producedBy"),
        example=fields.raw("example"),
        features=tuple(_feature(item) for item in fields.nested_list("features", limit=16)),
    )
    if (result.encoding is policy.Encoding.CDR) != (result.type is not None):
        fields.refuse("type", result.type, "a ROS 2 type with encoding cdr, and none with another encoding")
    for name in ("ros", "types"):
        if name in fields and result.encoding is not policy.Encoding.CDR:
            fields.refuse(name, fields.raw(name), "encoding cdr with it: other encodings have no message types")
    fields.close()
    return result


def _feature(fields: Fields) -> policy.Feature:
    result = policy.Feature(
        name=fields.text("name", pattern=FEATURE_NAME, allowed=FEATURE_NAME_ALLOWED),
        op=policy.FeatureOp.COUNT if "op" not in fields else fields.choice("op", policy.FeatureOp.COUNT),
        over=fields.duration("over") or 0.0,
        of=fields.cel("of"),
    )
    if "op" not in fields:
        fields.refuse("op", fields.raw("op"), "one of " + ", ".join(policy.FeatureOp))
    if result.over <= 0:
        fields.refuse("over", fields.raw("over"), "a duration above 0")
    if result.of is None and result.op not in (policy.FeatureOp.RATE, policy.FeatureOp.COUNT):
        fields.refuse("of", None, f"a CEL number, {result.op} needs one")
    fields.close()
    return result


def _task(fields: Fields) -> policy.Task:
    name = fields.text("name", pattern=TASK_NAME, allowed=TASK_NAME_ALLOWED)
    activity = tuple(_activity(item) for item in fields.nested_list("activity", limit=16))
    priority, minimum = fields.number("priority"), fields.cpu("min")
    result = policy.Task(
        name=name,
        selector=_selector(fields.nested("selector")) if "selector" in fields else fields.raw("selector"),
        container=fields.text("container", name),
        priority=1.0 if priority is None else priority,
        idle=fields.number("idle"),
        min=max(10, minimum or 0),
        max=fields.cpu("max"),
        suspended_cpu=max(10, fields.cpu("suspendedCpu") or 0),
        needs=_needs(fields.nested("needs")),
        activity=activity,
        requires=tuple(_requirement(item) for item in fields.nested_list("requires", limit=16)),
        subtasks=fields.texts("subtasks", limit=16),
        satisfied_by=fields.choice("satisfiedBy", policy.SatisfiedBy.ALL),
        protected=fields.flag("protected"),
        restart_on_resize=fields.flag("restartOnResize"),
    )
    if (result.selector is None) == (not result.subtasks):
        fields.refuse(
            "selector",
            fields.raw("selector"),
            "a selector for a task in a container, subtasks for one without",
        )
    if result.subtasks:
        for group_less in ("min", "max", "suspendedCpu", "needs", "container", "restartOnResize"):
            if group_less in fields:
                fields.refuse(group_less, fields.raw(group_less), "only on a task in a container: a group has subtasks")
    if result.max is not None and not result.min <= result.max:
        fields.refuse("max", fields.raw("max"), f"at least min ({minimum or 10}m) and at least 10m")
    elif result.max is not None and result.max < result.suspended_cpu:
        fields.refuse("suspendedCpu", fields.raw("suspendedCpu"), "at most max")
    if result.protected and result.subtasks:
        allowed = "true on a task in a container: protect the subtasks that need it"
        fields.refuse("protected", fields.raw("protected"), allowed)
    if result.protected and result.needs.enforce is policy.Enforce.SUSPEND:
        fields.refuse("needs.enforce", result.needs.enforce, "Report: a protected task is never suspended")
    fields.close()
    return result


def _selector(fields: Fields) -> Selector:
    labels = [SelectorRequirement(key, "In", (value,)) for key, value in fields.string_map("matchLabels").items()]
    for label in labels:
        _check_label(fields, f"matchLabels.{label.key}", label)
    expressions = []
    for item in fields.nested_list("matchExpressions", limit=16):
        operator = item.text("operator", pattern="|".join(OPERATORS), allowed="one of " + ", ".join(OPERATORS))
        expressions.append(SelectorRequirement(item.text("key"), operator, item.texts("values", limit=16)))
        _check_label(item, "key", expressions[-1])
        item.close()
    fields.close()
    if not labels and not expressions:
        fields.refuse("", {}, "at least one label: an empty selector would claim every pod")
    return Selector((*labels, *expressions))


def _check_label(fields: Fields, name: str, label: SelectorRequirement) -> None:
    """Refuse labels that no pod can have, by Kubernetes' own rules."""
    if label.key and not is_label_key(label.key):
        fields.refuse(name, label.key, LABEL_KEY_ALLOWED)
    for value in label.values:
        if not is_label_value(value):
            fields.refuse(name, value, LABEL_VALUE_ALLOWED)


def _needs(fields: Fields) -> policy.Needs:
    result = policy.Needs(
        fields.cpu("cores"),
        fields.memory("memory"),
        fields.duration("deadline"),
        fields.choice("enforce", policy.Enforce.REPORT),
    )
    fields.close()
    return result


def _activity(fields: Fields) -> policy.Activity:
    score = fields.number("score")
    result = policy.Activity(
        when=fields.cel("when", "true") or "true",
        stream=fields.optional_text("stream"),
        score=1.0 if score is None else score,
        score_from=fields.cel("scoreFrom"),
        hold=fields.duration("hold") or 0.0,
        decay=fields.duration("decay") or 0.0,
        initiative=fields.optional_text("initiative"),
        arguments=fields.string_map("with"),
    )
    if "scoreFrom" in fields and "score" in fields:
        fields.refuse("score", score, "score or scoreFrom, not both")
    fields.close()
    return result


def _requirement(fields: Fields) -> policy.Requirement:
    if ("when" in fields) == ("task" in fields):
        fields.refuse("when", fields.raw("when"), "either when, a CEL condition, or task, the name of another task")
    result = policy.Requirement(
        fields.cel("when", "true") or "true", fields.duration("hold") or 0.0, fields.optional_text("task")
    )
    if result.task is not None and "hold" in fields:
        fields.refuse("hold", fields.raw("hold"), "hold only beside when: a task is able to run or not")
    fields.close()
    return result


def _context(fields: Fields) -> policy.Context:
    result = policy.Context(
        name=fields.text("name", pattern=TASK_NAME, allowed=TASK_NAME_ALLOWED),
        when=fields.cel("when"),
        enter_after=fields.duration("enterAfter") or 0.0,
        exit_after=fields.duration("exitAfter") or 0.0,
        effects={task: _effect(item) for task, item in fields.mapping("tasks", limit=128).items()},
    )
    fields.close()
    return result


def _effect(fields: Fields) -> policy.Effect:
    result = policy.Effect(fields.number("weight"), fields.number("scale"), fields.flag("suspend"))
    if [result.weight is not None, result.scale is not None, result.suspend].count(True) != 1:
        fields.refuse(
            "",
            dict.fromkeys(n for n in ("weight", "scale", "suspend") if n in fields),
            "exactly one of weight, scale or suspend: true",
        )
    fields.close()
    return result
