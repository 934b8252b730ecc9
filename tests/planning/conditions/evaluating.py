"""Expressions over samples."""

from __future__ import annotations

from contextpolicy.planning.conditions.scope import Scope


def evaluate(source, **samples):
    scope = Scope()
    expression = scope.compile(source)
    for stream, value in samples.items():
        scope.bind(stream, value)
    return expression.evaluate(scope)
