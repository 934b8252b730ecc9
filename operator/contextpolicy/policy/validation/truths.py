"""Warnings about conditions that never hold, or always, as windows and the contexts that they read are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.validation.cases import never_hold
from contextpolicy.policy.validation.silence import filters
from contextpolicy.policy.validation.situations import Situations
from contextpolicy.policy.validation.unknowns import compiled
from contextpolicy.policy.written import expressions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.cel import Expression
    from contextpolicy.policy.spec import Policy


def truths(policy: Policy) -> Iterator[Finding]:
    """Each of them that does not contradict itself."""
    situations = Situations(policy)
    for written in expressions(policy):
        own = compiled(written.source)
        if written.is_number or not (own.variables or own.contexts) or never_hold(written.source):
            continue
        whatever = f", whatever {' and '.join(sorted(own.variables)) or 'any stream'} sends"
        is_until = written.field.endswith(".until")
        if situations.never(written.source):
            filtered = never_hold(written.source, given=filters(policy))
            why = _filtered(policy, own) if filtered else _defined(sorted(own.contexts)) or whatever
            yield Finding(
                written.field, written.source, f"never holds{why}{', so nothing ends it' if is_until else ''}"
            )
        elif not is_until and situations.always(written.source):
            yield Finding(written.field, written.source, f"always holds{whatever}")


def _defined(contexts: list[str]) -> str:
    are = "is" if len(contexts) == 1 else "are"
    return f", as {' and '.join(contexts)} {are} defined" if contexts else ""


def _filtered(policy: Policy, own: Expression) -> str:
    names = [one.name for one in policy.streams if one.filter and one.name in own.variables]
    return f": the filter of stream {' and '.join(names)} drops what it asks for"
