"""Loads one version of a policy with everything it names: message definitions, converters, plugged-in functions.

Never on the loop's thread: a ConfigMap costs a round trip, and parsing the first ROS 2 types a tenth of a second.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from contextpolicy.errors import ActuationError, Finding, FindingsError
from contextpolicy.policies import plugins
from contextpolicy.policy.cel import shared
from contextpolicy.policy.definition_files import of_config_map, with_definitions
from contextpolicy.policy.parsing import parse
from contextpolicy.policy.validation.mistakes import mistakes_in
from contextpolicy.policy.written import expressions

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from contextpolicy.cluster.fencing import PolicyApi
    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.policy.cel import Expression
    from contextpolicy.policy.definition_files import Definitions
    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.tenants import Tenants


@dataclass(frozen=True, slots=True)
class Loaded:
    """A policy that can run, with the functions it names; or None, with everything that is wrong in `rejected`.

    `unread` says that a ConfigMap could not be read, so the same object may be valid later. `compiled` are its
    expressions, kept for the planner.
    """

    policy: Policy | None = None
    initiatives: Mapping[str, Instantiate] = field(default_factory=dict)
    rejected: tuple[str, ...] = ()
    unread: bool = False
    compiled: tuple[Expression, ...] = ()


def load(body: Mapping[str, Any], api: PolicyApi, tenants: Tenants) -> Loaded:
    """Parse the object and read what it names; findings are returned, never raised."""
    files = _ConfigMaps(api)
    try:
        policy = files.complete(parse(body, tenants.findings, lambda policy: _findings(policy, files)))
        return Loaded(policy, plugins.load(policy), compiled=tuple(map(shared, _sources(policy))))
    except FindingsError as error:
        return Loaded(rejected=tuple(str(finding) for finding in error.findings), unread=bool(files.unread))


class _ConfigMaps:
    """Reads each ConfigMap once and keeps its content, or the error."""

    def __init__(self, api: PolicyApi) -> None:
        self.unread: dict[str, ActuationError] = {}
        self._api = api
        self._read: dict[str, Definitions] = {}

    def complete(self, policy: Policy) -> Policy:
        """The policy with the definitions that could be read."""
        return with_definitions(policy, lambda name: self._definitions(policy.namespace, name))

    def _definitions(self, namespace: str, name: str) -> Definitions | None:
        if name not in self._read and name not in self.unread:
            try:
                self._read[name] = of_config_map(self._api.config_map(namespace, name))
            except ActuationError as error:
                self.unread[name] = error
        return self._read.get(name)


def _sources(policy: Policy) -> Iterator[str]:
    yield from (written.source for written in expressions(policy))
    for stream in policy.streams:
        yield from filter(None, (stream.filter, *(feature.of for feature in stream.features)))


def _findings(policy: Policy, files: _ConfigMaps) -> Iterator[Finding]:
    yield from mistakes_in(files.complete(policy))
    for index, stream in enumerate(policy.streams):
        if stream.types is not None and stream.types in files.unread:
            expected = f"a ConfigMap of namespace {policy.namespace} that the chart's rosTypes names"
            yield Finding(f"spec.streams[{index}].types", stream.types, f"{expected}; {files.unread[stream.types]}")
