"""Metrics of what is the case now, read when Prometheus asks: nothing to keep up to date, nothing left behind.

The hot path pays nothing for them, and a deleted policy, stream or container is simply not there at the next scrape.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.registry import Collector

from contextpolicy.cluster.agent_reports import writing
from contextpolicy.cluster.container_names import container_id

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

    from contextpolicy.cluster.agent_reports import AgentReport
    from contextpolicy.cluster.claims import Claim
    from contextpolicy.cluster.nodes import NodeView
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.planning.planner import Planner

    Family: TypeAlias = CounterMetricFamily | GaugeMetricFamily
    Row: TypeAlias = tuple[Sequence[str], float]

_POLICY = ("namespace", "name")
_STREAM = (*_POLICY, "stream")


@dataclass(frozen=True, slots=True)
class ScrapedPolicy:
    """One policy: `running` are its planner and its claim, None where nothing of it runs.

    That is while no version of it was ever valid, and while it is being deleted.
    """

    reference: str
    conditions: Sequence[Mapping[str, Any]]
    running: tuple[Planner, Claim] | None


@dataclass(frozen=True, slots=True)
class Scraped:
    """The whole operator at one instant; `now` is the loop's time.

    `gone` are the nodes whose agent was there and is gone. `agents_everywhere` says that every node with tasks is to
    have one.
    """

    now: float
    connected: bool
    policies: Sequence[ScrapedPolicy]
    pods: Sequence[PodView]
    agents: Mapping[str, AgentReport]
    nodes: Sequence[NodeView]
    gone: Collection[str] = ()
    agents_everywhere: bool = False


class Scrape(Collector):
    """`read` returns the operator as it is, or None if it does not answer: then only that is missing from the page."""

    def __init__(self, read: Callable[[], Scraped | None]) -> None:
        self._read = read

    def describe(self) -> Iterator[Family]:
        """All families, empty: a registry asks for their names before there is an operator."""
        return families(Scraped(0.0, connected=False, policies=(), pods=(), agents={}, nodes=()))

    def collect(self) -> Iterator[Family]:
        """All families as of now."""
        scraped = self._read()
        if scraped is not None:
            yield from families(scraped)


def families(scraped: Scraped) -> Iterator[Family]:
    """The metric families.

    Ages are by the loop's clock and no timestamps: where a robot without a battery sets its clock late, every stream
    would seem to be years old.
    """
    policies = scraped.policies
    yield _gauge(
        "contextpolicy_bus_connected",
        "1 while the operator has a session with a router.",
        (),
        [((), scraped.connected)],
    )
    yield _gauge(
        "contextpolicy_condition",
        "1 while the policy's condition of this type is True, else 0.",
        (*_POLICY, "type"),
        [((*_split(p), c["type"]), c["status"] == "True") for p in policies for c in p.conditions],
    )
    yield from _stream_families(policies, scraped.now)
    yield _counter(
        "contextpolicy_context_transitions",
        "How often the context started or stopped holding.",
        (*_POLICY, "context"),
        [
            ((*_split(policy), context.spec.name), planner.transitions[context.spec.name])
            for policy, planner, _ in _running(policies)
            for context in planner.contexts
        ],
    )
    yield _gauge(
        "contextpolicy_container_limit_cores",
        "The container's CPU limit that the kubelet reports in force.",
        (*_POLICY, "task", "pod", "container"),
        list(_limits(policies, scraped.pods)),
    )
    yield from _node_families(scraped)


def _stream_families(policies: Iterable[ScrapedPolicy], now: float) -> Iterator[Family]:
    yield _gauge(
        "contextpolicy_stream_age_seconds",
        "Time since the stream's last sample; absent before its first.",
        _STREAM,
        [(key, now - s.seen_at) for key, s in _streams(policies) if s.seen_at is not None],
    )
    yield _gauge(
        "contextpolicy_stream_silent",
        "1 while the stream is silent: no sample for staleAfter, or its publisher is gone.",
        _STREAM,
        [(key, stream.silent) for key, stream in _streams(policies)],
    )
    yield _counter(
        "contextpolicy_samples",
        "Samples that were decoded, used or not.",
        _STREAM,
        [(key, stream.seen) for key, stream in _streams(policies)],
    )


def _node_families(scraped: Scraped) -> Iterator[Family]:
    yield _gauge(
        "contextpolicy_node_agent_ready",
        "1 while plans rely on the node's agent; 0 while it is gone, unresponsive, or lacks something that it needs.",
        ("node",),
        [((node,), node in writing(scraped.agents)) for node in sorted(scraped.agents.keys() | _agentless(scraped))],
    )
    yield _gauge(
        "contextpolicy_kubelet_delay_seconds",
        "How long kubelets of the policy's pods may take to resize: 2 before Kubernetes 1.36, else 0; 0 with agents.",
        _POLICY,
        list(_delays(scraped)),
    )


def _running(policies: Iterable[ScrapedPolicy]) -> Iterator[tuple[ScrapedPolicy, Planner, Claim]]:
    for policy in policies:
        if policy.running is not None:
            yield policy, *policy.running


def _streams(policies: Iterable[ScrapedPolicy]) -> Iterator[tuple[tuple[str, ...], Any]]:
    for policy, planner, _ in _running(policies):
        for name, stream in planner.streams.items():
            yield (*_split(policy), name), stream


def _limits(policies: Iterable[ScrapedPolicy], pods: Sequence[PodView]) -> Iterator[Row]:
    for policy, _, claim in _running(policies):
        tasks = {container.id: container.task for container in claim.placement.containers}
        for pod in pods:
            for container in pod.containers:
                task = tasks.get(container_id(pod, container.name))
                if task is not None and container.actual and container.actual.limit is not None:
                    yield (*_split(policy), task, pod.name, container.name), container.actual.limit / 1000


def _agentless(scraped: Scraped) -> set[str]:
    """The nodes without the agent that they should have; one that is switched off is not missed."""
    wanted = set(scraped.gone)
    if scraped.agents_everywhere:
        wanted.update(node for _, _, claim in _running(scraped.policies) for node in claim.placement.allocatable)
    return wanted & {node.name for node in scraped.nodes if node.ready} - scraped.agents.keys()


def _delays(scraped: Scraped) -> Iterator[Row]:
    delays = {node.name: node.delay for node in scraped.nodes if node.name not in writing(scraped.agents)}
    for policy, _, claim in _running(scraped.policies):
        yield _split(policy), max((delays.get(node, 0.0) for node in claim.placement.allocatable), default=0.0)


def _split(policy: ScrapedPolicy) -> list[str]:
    return policy.reference.split("/")


def _gauge(name: str, text: str, labels: Sequence[str], rows: Iterable[Row]) -> GaugeMetricFamily:
    family = GaugeMetricFamily(name, text, labels=labels)
    _fill(family, rows)
    return family


def _counter(name: str, text: str, labels: Sequence[str], rows: Iterable[Row]) -> CounterMetricFamily:
    family = CounterMetricFamily(name, text, labels=labels)
    _fill(family, rows)
    return family


def _fill(family: GaugeMetricFamily | CounterMetricFamily, rows: Iterable[Row]) -> None:
    for labels, value in rows:
        family.add_metric(list(labels), float(value))
