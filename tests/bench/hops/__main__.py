"""Where the time goes between a sample and the node agent's last cgroup write, hop by hop, beside the floor.

    python -m tests.bench.hops [--rounds N]

Sensor, router, operator and agent are processes of their own on loopback, with TLS and roles as the chart sets them up.
The operator has a stand-in cluster; the agent writes cgroups of this machine that limit nobody,
where cgroup version 1 is mounted and it may, else plain files. Two floors take turns with it, through the same router:

    two hops   a sensor, a process that passes each message on, and one that writes the files, which are open
    one hop    without the process between

What passes is as large as the plan. Prints a table for a plan of 1 limit and one of 30, writes build/bench/hops.json.
Both are measured on a bus that is silent otherwise, and with an IMU of 200 Hz that changes nothing, as on a robot: it
keeps router, operator and the process between awake and their caches warm.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import zenoh

from contextpolicy.bus.decision_bus import plan_key
from contextpolicy.bus.session import open_visitor
from tests.bench.child import Child
from tests.bench.engine_measure import machine
from tests.bench.hops.case import NAMESPACE, RELAYED, SENT, STREAM, names
from tests.bench.hops.stamps import legs
from tests.bench.hops.tree import cgroups, container_id, uid
from tests.bench.reaction.figures import percentile
from tests.bench.results import keep
from tests.bus.certificates import Authority, signing_keys
from tests.cluster.builders import NODE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contextpolicy.agent.cgroup_paths import CgroupPaths

LIMITS = (1, 30)
RATES = (0, 200)
"""Samples per second of the IMU. Its samples pass the first hops too, so with it only the sum of all is reported."""
PORT = 17451
SETTLING, PATIENCE = 3.0, 10.0
PAUSE, LOOKS = 0.08, 5
"""Seconds after each message, which are enough for all that it causes on a quiet machine; and how often to look."""
WARM_UP = 20
GOALS = {"agent_ms_p50": 1.0, "agent_ms_p50_30": 3.0}
WITHIN = 1.5
"""Times the floor, where a goal can't be met."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=200)
    options = parser.parse_args()
    cases = {_name(limits, rate): _case(limits, rate, options.rounds) for rate in RATES for limits in LIMITS}
    result = {
        "agent_ms_p50": cases["1"]["agent"]["p50_ms"],
        "agent_ms_p50_30": cases["30"]["agent"]["p50_ms"],
        "agent_over_floor": cases["1"]["over_floor"],
        "agent_over_floor_30": cases["30"]["over_floor"],
        "agent_ms_p50_imu": cases[_name(1, 200)]["agent"]["p50_ms"],
        "agent_ms_p50_30_imu": cases[_name(30, 200)]["agent"]["p50_ms"],
        "cases": cases,
        "machine": machine(),
    }
    keep("hops", result)
    print(_text(result))
    return 0


@dataclass(frozen=True)
class Bus:
    """Where the router listens, and who may speak there."""

    endpoint: str
    authority: Authority

    def role(self, role: str) -> str:
        """The credentials of a role."""
        return str(self.authority.issue(role))


def _name(limits: int, rate: int) -> str:
    return f"{limits}, beside an IMU of {rate} Hz" if rate else str(limits)


def _case(limits: int, rate: int, rounds: int) -> dict[str, Any]:
    """Medians for a plan of so many limits beside an IMU of so many samples per second."""
    with ExitStack() as stack:
        place = Path(stack.enter_context(TemporaryDirectory()))
        bus = Bus(f"tls/127.0.0.1:{PORT + limits}", Authority(place / "bus"))
        router = ("contextpolicy", "router", "--listen", bus.endpoint, "--credentials", bus.role("router"))
        stack.enter_context(Child("-m", *router))
        layout = stack.enter_context(cgroups(place / "cgroup", [*names(limits), *_floor_names(limits)]))
        made = _Rounds(stack, place, bus, layout, limits)
        if rate:
            stack.enter_context(_subject("sensor", bus.endpoint, bus.role("module"), str(rate)))
        measured = made.measure(rounds)
        return {what: found for what, found in measured.items() if not (rate and what == "hops_ms_p50")}


def _floor_names(limits: int) -> list[str]:
    """The containers whose limits the floor writes: none of the agent's, which would take note of it."""
    return [f"floor-{number}" for number in range(limits)]


class _Rounds:
    """The path and its floors, which take turns."""

    def __init__(self, stack: ExitStack, place: Path, bus: Bus, layout: CgroupPaths, limits: int) -> None:
        self._limits = limits
        keys = str(signing_keys(place / "plans"))
        agent = {
            **_agent_settings(place, limits),
            "PLAN_SIGNING": keys,
            "ZENOH_CONNECT": bus.endpoint,
            "ZENOH_CREDENTIALS": bus.role("agent"),
        }
        self._agent = stack.enter_context(_subject("agent", environment=agent))
        time.sleep(SETTLING)
        self._operator = stack.enter_context(
            _subject("operator", bus.endpoint, bus.role("operator"), keys, str(limits))
        )
        session = stack.enter_context(open_visitor([bus.endpoint], patience=5.0, credentials=Path(bus.role("module"))))
        self._samples, self._sent, self._relayed = (_publisher(session, key) for key in (STREAM, SENT, RELAYED))
        time.sleep(SETTLING)
        self._left = False
        self.size = self._plan_size(session)
        files = [_quota(layout, name) for name in _floor_names(limits)]
        stack.enter_context(_subject("relay", bus.endpoint, bus.role("module"), str(self.size)))
        self._writer = stack.enter_context(_subject("writer", bus.endpoint, bus.role("module"), *files))
        time.sleep(SETTLING)

    def measure(self, rounds: int) -> dict[str, Any]:
        """Medians over the rounds; those with a hop that was missed are counted."""
        for _ in range(WARM_UP):
            self._round()
        made = [self._round() for _ in range(rounds)]
        whole = [(ours, two, one) for ours, two, one in made if ours and two and one]
        hops, two, one = zip(*whole, strict=True)
        totals = [sum(ours.values()) for ours in hops]
        return {
            "hops_ms_p50": {what: round(median(ours[what] for ours in hops), 3) for what in hops[0]},
            "agent": _spread(totals),
            "two hops": _spread(two),
            "one hop": _spread(one),
            "over_floor": round(median(totals) / median(two), 2),
            "missed": rounds - len(whole),
            "plan_bytes": self.size,
        }

    def _round(self) -> tuple[dict[str, float] | None, float | None, float | None]:
        return self._ours(), self._floor(self._sent, b"x"), self._floor(self._relayed, b"x" * self.size)

    def _ours(self) -> dict[str, float] | None:
        began, notes = self._turn(), []
        for _ in range(LOOKS):
            time.sleep(PAUSE)
            notes += [*self._operator.ask(), *self._agent.ask()]
            if (found := legs(notes, began)) is not None:
                return found
        return None

    def _turn(self) -> int:
        self._left = not self._left
        payload, began = json.dumps({"left": self._left}), time.time_ns()
        self._samples.put(payload)
        return began

    def _floor(self, publisher: zenoh.Publisher, payload: bytes) -> float | None:
        began = time.time_ns()
        publisher.put(payload)
        for _ in range(LOOKS):
            time.sleep(PAUSE)
            if (written := self._writer.ask()) > began:
                return float(written - began) / 1e6
        return None

    def _plan_size(self, session: zenoh.Session) -> int:
        """The bytes of a plan; it is one that the agent obeyed."""
        self._turn()
        [reply] = session.get(plan_key(NAMESPACE, "bench"), timeout=PATIENCE)
        assert reply.ok is not None
        payload = reply.ok.payload.to_bytes()
        assert len(json.loads(payload)["targets"]) == len(names(self._limits))
        return len(payload)


def _agent_settings(place: Path, limits: int) -> dict[str, str]:
    """A node's directories, as the chart mounts them."""
    logs, state = place / "pods", place / "run"
    state.mkdir()
    for name in names(limits):
        (logs / f"{NAMESPACE}_{name}_{uid(name)}").mkdir(parents=True)
    directories = {"CGROUP_ROOT": place / "cgroup", "POD_LOGS": logs, "STATE_DIRECTORY": state}
    return {
        **{name: str(directory) for name, directory in directories.items()},
        "NODE_NAME": NODE,
        "METRICS_PORT": str(PORT + 100 + limits),
    }


def _subject(kind: str, *arguments: str, environment: dict[str, str] | None = None) -> Child:
    return Child("-m", "tests.bench.hops.subject", kind, *arguments, environment=environment)


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(key, express=True, congestion_control=zenoh.CongestionControl.BLOCK)


def _quota(layout: CgroupPaths, name: str) -> str:
    return str(layout.container("Burstable", uid(name), container_id(name)) / "cpu.cfs_quota_us")


def _spread(times: Sequence[float]) -> dict[str, float]:
    return {f"p{percent}_ms": round(percentile(times, percent), 3) for percent in (50, 90, 99)}


def _text(result: dict[str, Any]) -> str:
    lines = [f"{result['machine']}", ""]
    for limits, case in result["cases"].items():
        lines.append(f"limits: {limits}; a plan of {case['plan_bytes']} bytes; {case['missed']} missed; ms, medians:")
        lines += [f"  {what:40} {ms:7.3f}" for what, ms in case.get("hops_ms_p50", {}).items()]
        for what in ("agent", "two hops", "one hop"):
            reported = "  ".join(f"{name.removesuffix('_ms')} {ms:.3f}" for name, ms in case[what].items())
            lines.append(f"  {what:40} {reported}")
        lines += [f"  over the floor of two hops {case['over_floor']:20}   goal <= {WITHIN}", ""]
    lines += [f"  {name:20} {result[name]:6.2f}   goal <= {goal}" for name, goal in GOALS.items()]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
