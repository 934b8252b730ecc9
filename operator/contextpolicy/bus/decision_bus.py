"""The decision bus on Zenoh: its keys, and one policy's place on it, for modules, agents, recorders and live views."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Protocol

import msgspec
import zenoh

from contextpolicy.streams.direct import directly

if TYPE_CHECKING:
    from collections.abc import Callable

    from zenoh.handlers import Callback

    from contextpolicy.bus.questions import Questions
    from contextpolicy.bus.signatures import PlanSigner
    from contextpolicy.cluster.fencing import Fence
    from contextpolicy.policy.spec import Policy


def plan_key(namespace: str, name: str) -> str:
    """The key of a policy's plans."""
    return f"contextpolicy/{namespace}/{name}/plan"


def policy_of(key: str) -> str:
    """The policy that a key of the decision bus belongs to, as `namespace/name`."""
    return "/".join(key.split("/")[1:3])


def node_of(key: str) -> str:
    """The node that an agent's key belongs to, empty if it is none."""
    return "".join(key.split("/")[2:3])


def agent_key(node: str) -> str:
    """The key of a node's agent: a liveliness token while it lives, and a queryable for what the node can do."""
    return f"contextpolicy/agents/{node}"


def confirmed_key(node: str) -> str:
    """The key on which a node's agent confirms the plans that it has carried out."""
    return f"{agent_key(node)}/confirmed"


def usage_key(node: str) -> str:
    """The key that answers with what the node's containers have used."""
    return f"{agent_key(node)}/usage"


def applied_key(namespace: str, name: str) -> str:
    """The key that reports which limits the API has accepted and the node has put in force."""
    return f"contextpolicy/{namespace}/{name}/applied"


def topic_key(namespace: str, name: str, topic: str) -> str:
    """The key of a policy for `plan`, `explain` (answers with the explanation of the plan) or `board`."""
    return f"contextpolicy/{namespace}/{name}/{topic}"


class Answers(Protocol):
    """What queries for a policy are answered with, on the loop's thread; None when there is no answer yet."""

    def message(self) -> dict[str, Any] | None:
        """The plan in force."""

    def explain(self) -> dict[str, Any] | None:
        """Why each task has its share."""

    def board(self) -> dict[str, Any] | None:
        """The policy as the live page shows it."""


class Bus:
    """One policy's place on the decision bus: publishes plans, answers queries for the last one and its explanation."""

    def __init__(  # noqa: PLR0913 - who speaks, for which policy, under whose name
        self,
        session: zenoh.Session,
        policy: Policy,
        questions: Questions,
        answers: Answers,
        *,
        signer: PlanSigner,
        fence: Fence,
    ) -> None:
        """The liveliness token on the plans' key shows agents that an operator still makes plans.

        Agents ignore plans that the `signer` does not sign. The `fence` is asked before each message and answer: an
        operator that lost its Lease must be silent at once.
        """
        self._questions, self._signer, self._fence = questions, signer, fence
        self._namespace = policy.namespace
        self._key = key = plan_key(policy.namespace, policy.name)
        self._publisher = session.declare_publisher(
            key, express=True, congestion_control=zenoh.CongestionControl.DROP, priority=zenoh.Priority.REAL_TIME
        )
        self._applied = session.declare_publisher(
            applied_key(policy.namespace, policy.name), congestion_control=zenoh.CongestionControl.DROP
        )
        topics = {"plan": answers.message, "explain": answers.explain, "board": answers.board}
        self._queryables = [
            session.declare_queryable(of, self._answer(of, content))
            for topic, content in topics.items()
            for of in [topic_key(policy.namespace, policy.name, topic)]
        ]
        self._token = session.liveliness().declare_token(key)

    def publish(self, plan: dict[str, Any]) -> bytes | None:
        """Publish a plan, and return it as it was sent, None if we may not. A slow listener never slows the loop."""
        if not self._may_speak():
            return None
        payload = msgspec.json.encode(plan)
        self._publisher.put(payload, encoding=zenoh.Encoding.APPLICATION_JSON, attachment=self._signature(payload))
        return payload

    def withdraw(self) -> None:
        """Declare that no plan of this policy holds any more."""
        if self._may_speak():
            self._publisher.delete(attachment=self._signature(None))

    def publish_applied(self, step: dict[str, Any]) -> None:
        """Report that a container's limit reached the next stage."""
        if self._may_speak():
            self._applied.put(msgspec.json.encode(step), encoding=zenoh.Encoding.APPLICATION_JSON)

    def close(self) -> None:
        """Leave the bus."""
        self._token.undeclare()
        for queryable in self._queryables:
            queryable.undeclare()
        self._applied.undeclare()
        self._publisher.undeclare()

    def _may_speak(self) -> bool:
        return self._fence.may_act(self._namespace)

    def _signature(self, payload: bytes | None) -> bytes | None:
        """The attachment that proves to agents that a plan, or its withdrawal (None), comes from the operator."""
        return self._signer.sign(self._key, payload, time.time_ns())

    def _answer(self, key: str, content: Callable[[], dict[str, Any] | None]) -> Callback[zenoh.Query]:
        """A query callback that replies from the loop, since Zenoh's callbacks must not call Zenoh.

        The reply names its own key because a query with wildcards may address all policies at once.
        """

        def reply(query: zenoh.Query) -> None:
            answer = content() if self._may_speak() else None
            if answer is not None:
                payload = msgspec.json.encode(answer)
                signature = self._signature(payload) if key == self._key else None
                query.reply(key, payload, encoding=zenoh.Encoding.APPLICATION_JSON, attachment=signature)

        return directly(lambda query: self._questions.ask(policy_of(key), query, reply))
