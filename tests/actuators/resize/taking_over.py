"""A node whose agent may be gone, and what the kubelet is asked to write."""

from __future__ import annotations

from contextpolicy.actuators.order import Order
from contextpolicy.actuators.resize.takeover import REWRITE_AFTER
from tests.actuators.resize.rig import POLICY, Rig
from tests.cluster.builders import NODE, a_pod

HERE, NOWHERE = frozenset({NODE}), frozenset[str]()
FAR = "robot-2"
OVER = REWRITE_AFTER + 0.1


def an_order(agents, *, capacity=1000, limits=None, node=NODE, attended=None, **shares):
    named = {f"lab/{name}/{name}": share for name, share in shares.items()}
    limits = {f"lab/{name}/{name}": limit for name, limit in (limits or shares).items()}
    nodes = dict.fromkeys(named, node)
    return Order(
        POLICY,
        frozenset(named),
        named,
        {node: capacity},
        limits,
        nodes=nodes,
        agents=agents,
        attended=agents if attended is None else attended,
    )


def in_force(*pods, **shares):
    """A plan that the API has put in force behind an agent; the calls for it are forgotten."""
    rig = Rig(*(pods or (a_pod(name) for name in shares)))
    rig.apply(an_order(HERE, **shares))
    rig.settle()
    rig.cluster.calls.clear()
    return rig


def asked(rig):
    """Every resize: pod, its request and its limit."""
    found = []
    for call, name, patch in rig.cluster.calls:
        if call == "resize":
            [resources] = [c["resources"] for c in patch["spec"]["containers"]]
            found.append((name, resources["requests"]["cpu"], resources["limits"]["cpu"]))
    return found
