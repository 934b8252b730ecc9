"""What rmw_zenoh announces about its nodes, so that `ros2 node list`, `topic list` and `topic info` show a module.

Each node, publisher and subscription has a liveliness token whose key says all (ros2/rmw_zenoh, `liveliness_utils.cpp`
and `qos.cpp` on the branches jazzy to rolling, and `docs/design.md`):

    @ros2_lv/<domain>/<session>/<node>/<id>/<NN|MP|MS>/<enclave>/<namespace>/<name>[/<topic>/<type>/<hash>/<QoS>]

Slashes within a part are `%`; QoS has the values that differ from rmw_zenoh's own defaults. Pure.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Self

ADMIN_SPACE = "@ros2_lv"
NODE, PUBLISHER, SUBSCRIPTION = "NN", "MP", "MS"
_DEFAULT_DEPTH = 42
_KEY = re.compile(r"(?P<domain>\d+)/(?P<topic>.+)/(?P<type>\w+::\w+::dds_::\w+_)/(?P<hash>[^/]+)")
_TYPED = re.compile(r"(?:.*/)?(?P<type>\w+::\w+::dds_::\w+_)(?:/(?P<hash>[^/]+))?")
_WILD = re.compile(r"[*$]")


@dataclass(frozen=True, slots=True)
class GraphTopic:
    """A topic as the key of rmw_zenoh has it; `depth` is how many messages are kept."""

    domain: int
    name: str
    type: str
    hash: str
    depth: int = 10


@dataclass(frozen=True, slots=True)
class GraphNode:
    """A node in a domain, in Zenoh's session `session`; `name` may have letters, digits and underscores."""

    session: str
    name: str
    domain: int = 0
    namespace: str = "/"
    enclave: str = "/"

    def of(self, domain: int) -> Self:
        """The same node in another domain."""
        return replace(self, domain=domain)

    def token(self) -> str:
        """The node's own token."""
        return self._token(0, NODE)

    def endpoint(self, number: int, kind: str, topic: GraphTopic) -> str:
        """The token of a publisher or subscription; `number` is its own within the session, the node's is 0."""
        described = (_mangled(topic.name), topic.type, topic.hash, _qos(topic.depth))
        return "/".join((self._token(number, kind), *described))

    def _token(self, number: int, kind: str) -> str:
        named = map(_mangled, (self.enclave, self.namespace, self.name))
        return "/".join((ADMIN_SPACE, str(self.domain), self.session, "0", str(number), kind, *named))


def dds_name(type_name: str) -> str:
    """A message type as the keys of rmw_zenoh name it."""
    package, _, name = type_name.partition("/msg/")
    return f"{package}::msg::dds_::{name}_"


def type_in(key: str) -> tuple[str, str] | None:
    """The type that a key of rmw_zenoh names and its hash, empty if it has none; None for another key."""
    found = _TYPED.fullmatch(key)
    return (found["type"], found["hash"] or "") if found is not None else None


def topic_of(key: str, *, type_hash: str) -> GraphTopic | None:
    """The topic of a key of rmw_zenoh; None for another key, or one with wildcards in more than the type's hash."""
    found = _KEY.fullmatch(key)
    if found is None or _WILD.search(found["topic"]):
        return None
    known = type_hash if _WILD.search(found["hash"]) else found["hash"]
    return GraphTopic(int(found["domain"]), f"/{found['topic']}", found["type"], known)


def node_name(task: str) -> str:
    """A task's name as ROS allows it for nodes: ASCII letters, digits and underscores, no digit first."""
    name = re.sub(r"\W", "_", task, flags=re.ASCII)
    return f"task_{name}" if name[:1].isdigit() else name  # an underscore first would hide it from `ros2 node list`


def _mangled(name: str) -> str:
    return name.replace("/", "%")


def _qos(depth: int) -> str:
    """Reliable, volatile, the last `depth`, no deadline, lifespan or lease: rmw_zenoh's defaults but for the depth."""
    return f"::,{'' if depth == _DEFAULT_DEPTH else depth}:,:,:,,"
