"""Makes a module visible to ROS: a node with its publishers and subscriptions, as long as it has them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from robotkit.module import Input
from robotkit.ros_graph import PUBLISHER, SUBSCRIPTION, GraphNode, GraphTopic, node_name, topic_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    import zenoh

    from robotkit.module import Module, Output

CDR = "cdr"


class RosPresence:
    """Declares the node and its publishers; its subscriptions come and go with `resume` and `pause`.

    Nothing is declared of a module whose keys are not rmw_zenoh's.
    """

    def __init__(self, session: zenoh.Session, task: str, module: Module) -> None:
        self._session = session
        self._node = GraphNode(str(session.info.zid()), node_name(task))
        published, self._subscribed = _topics(module.outputs.values()), _topics(module.inputs.values())
        self._first = 1 + len(published)
        own = [self._node.of(domain).token() for domain in _domains(published + self._subscribed)]
        own += [self._node.of(one.domain).endpoint(at, PUBLISHER, one) for at, one in enumerate(published, start=1)]
        self._own = [session.liveliness().declare_token(token) for token in own]
        self._subscriptions: list[zenoh.LivelinessToken] = []

    def resume(self) -> None:
        """Announce the subscriptions, unless they are announced already."""
        if not self._subscriptions:
            tokens = [
                self._node.of(one.domain).endpoint(at, SUBSCRIPTION, one)
                for at, one in enumerate(self._subscribed, start=self._first)
            ]
            self._subscriptions = [self._session.liveliness().declare_token(token) for token in tokens]

    def pause(self) -> None:
        """Withdraw the subscriptions: a suspended task has none."""
        for token in self._subscriptions:
            token.undeclare()
        self._subscriptions = []

    def close(self) -> None:
        """Withdraw everything."""
        self.pause()
        for token in self._own:
            token.undeclare()
        self._own = []


def _topics(entries: Iterable[Input | Output]) -> list[GraphTopic]:
    return [topic for entry in entries if entry.encoding == CDR and (topic := _topic(entry)) is not None]


def _topic(entry: Input | Output) -> GraphTopic | None:
    from robotkit.ros_types import hash_of  # noqa: PLC0415 - an extra, and megabytes

    topic = topic_of(entry.key, type_hash=hash_of(entry.type, entry.ros, entry.types))
    return replace(topic, depth=entry.depth) if topic is not None and isinstance(entry, Input) else topic


def _domains(topics: Iterable[GraphTopic]) -> list[int]:
    return sorted({topic.domain for topic in topics})
