"""Warnings: what is allowed but can't be intended. Each is certain, not a matter of taste."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.spec import Enforcement, Scheduler
from contextpolicy.policy.stream_spec import FeatureOp
from contextpolicy.policy.validation.ages import ages
from contextpolicy.policy.validation.beginnings import beginnings
from contextpolicy.policy.validation.effects import effects
from contextpolicy.policy.validation.frozen import frozen
from contextpolicy.policy.validation.latches import latches
from contextpolicy.policy.validation.plain_values import plain_values
from contextpolicy.policy.validation.priorities import priorities
from contextpolicy.policy.validation.silence import fallbacks
from contextpolicy.policy.validation.sleepers import sleepers
from contextpolicy.policy.validation.source_fields import source_fields
from contextpolicy.policy.validation.standing import standing
from contextpolicy.policy.validation.thresholds import thresholds
from contextpolicy.policy.validation.truths import truths
from contextpolicy.policy.written import expressions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy, Task


MQTT_WILDCARD = "+"


def advice(policy: Policy) -> Iterator[Finding]:
    """Every warning about a valid policy; a finding's `allowed` holds the reason."""
    yield from _streams(policy)
    yield from _wildcard("spec.shadow.health", policy.shadow.health if policy.shadow else "")
    for index, task in enumerate(policy.tasks):
        yield from _task(policy, f"spec.tasks[{index}]", task)
    yield from _contexts(policy)
    yield from _realtime(policy)
    yield from priorities(policy)
    yield from effects(policy)
    yield from latches(policy)
    yield from sleepers(policy)
    yield from standing(policy)
    yield from thresholds(policy)
    yield from truths(policy)
    yield from ages(policy)
    yield from beginnings(policy)
    yield from frozen(policy)
    yield from source_fields(policy)
    yield from plain_values(policy)


def _realtime(policy: Policy) -> Iterator[Finding]:
    """Settings of scheduler Realtime beside the other one."""
    own, usual = policy.enforcement, Enforcement()
    if own.scheduler is Scheduler.REALTIME:
        return
    for name, value, default in (
        ("realtimePolicy", own.realtime_policy, usual.realtime_policy),
        ("realtimeFallback", own.realtime_fallback, usual.realtime_fallback),
    ):
        if value is not default:
            yield Finding(f"spec.enforcement.{name}", value, f"{name} has no effect without scheduler: Realtime")


def _streams(policy: Policy) -> Iterator[Finding]:
    sources = [written.source for written in expressions(policy)]
    read = {name for source in sources for name in Expression(source).variables}
    read |= {activity.stream for task in policy.tasks for activity in task.activity if activity.stream}
    # Nobody can know what a plug-in reads: with one, no stream or feature is reported as unread.
    plugged_in = any(activity.initiative for task in policy.tasks for activity in task.activity)
    for index, stream in enumerate(policy.streams):
        # A stream may matter by its silence alone, which puts the fallback in force.
        watched = (stream.fallback or policy.fallback) and (stream.stale_after or stream.liveliness)
        if stream.name not in read and not plugged_in and not watched:
            yield Finding(f"spec.streams[{index}]", stream.name, f"nothing reads stream {stream.name}")
        if stream.types and stream.definitions is None:
            message = f"ConfigMap {stream.types} is in none of the files, so its messages are not checked (--types DIR)"
            yield Finding(f"spec.streams[{index}].types", stream.types, message)
        yield from _wildcard(f"spec.streams[{index}].key", stream.key)
        yield from _wildcard(f"spec.streams[{index}].liveliness", stream.liveliness or "")
        for number, feature in enumerate(stream.features):
            if feature.of is not None and feature.op in (FeatureOp.RATE, FeatureOp.COUNT):
                message = f"of has no effect on {feature.op}, which counts the samples that pass the stream's filter"
                yield Finding(f"spec.streams[{index}].features[{number}].of", feature.of, message)
            pattern = re.compile(rf"\b{stream.name}(\.{feature.name}\b|\[['\"]{feature.name}['\"]\])")
            if not plugged_in and not any(pattern.search(source) for source in sources):
                field = f"spec.streams[{index}].features[{number}]"
                yield Finding(
                    field,
                    feature.name,
                    f"nothing reads {stream.name}.{feature.name}, which costs time with every sample",
                )


def _wildcard(field: str, key: str) -> Iterator[Finding]:
    if MQTT_WILDCARD in key.split("/"):
        message = f"{MQTT_WILDCARD} is MQTT's wildcard for one level; Zenoh's is *, and + is an ordinary name"
        yield Finding(field, key, message)


def _task(policy: Policy, field: str, task: Task) -> Iterator[Finding]:
    if task.restart_on_resize and not policy.enforcement.min_dwell:
        message = "every plan that changes its share may restart it: minDwell bounds how often"
        yield Finding(f"{field}.restartOnResize", task.restart_on_resize, message)


def _contexts(policy: Policy) -> Iterator[Finding]:
    begun = fallbacks(policy)
    if policy.fallback and policy.fallback not in begun:
        message = "never holds: no stream without a fallback of its own has staleAfter or liveliness"
        yield Finding("spec.fallback", policy.fallback, message)
    read = frozenset[str]().union(*(Expression(written.source).contexts for written in expressions(policy)))
    for index, context in enumerate(policy.contexts):
        field = f"spec.contexts[{index}]"
        forced = policy.force is not None and policy.force.context == context.name
        never = (context.when or "false").strip() == "false"
        if never and not forced and context.name not in {*begun, policy.fallback}:
            what = "its condition is false" if context.when else "it has no condition"
            message = f"can't hold: {what}, and it is neither the fallback nor forced"
            yield Finding(field, context.name, f"context {context.name} {message}")
        for name, delay in (("enterAfter", context.enter_after), ("exitAfter", context.exit_after)):
            if delay and context.when is None:
                message = f"has no effect without when: silence and force begin and end {context.name} at once"
                yield Finding(f"{field}.{name}", delay, f"{name} {message}")
        if not context.effects and context.name not in read:
            yield Finding(field, context.name, f"context {context.name} changes no task")
        steadied = context.until or context.enter_after or context.exit_after or policy.enforcement.min_dwell
        if context.when and Expression(context.when).variables and not steadied:
            message = "may change with every sample: until, enterAfter, exitAfter or minDwell make resizes rarer"
            yield Finding(field, context.name, f"context {context.name} {message}")
