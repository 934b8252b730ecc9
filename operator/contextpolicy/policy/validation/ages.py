"""Warnings about ages that a stream reaches between its samples although its sender is alive."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.validation.unknowns import compiled
from contextpolicy.policy.written import expressions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy


def ages(policy: Policy) -> Iterator[Finding]:
    """Each age below the `sampleEvery` of its stream."""
    pauses = {one.name: one.sample_every for one in policy.streams}
    for written in expressions(policy):
        for age in sorted(compiled(written.source).ages):
            pause = pauses[age.stream]
            if age.seconds < pause:
                message = f"age({age.stream}) exceeds {age.seconds:g} s between any two samples: "
                message += f"with sampleEvery one counts in {pause:g} s"
                yield Finding(written.field, written.source, message)
