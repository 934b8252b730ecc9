"""What operator, router and agent take on a real node: memory, CPU, image, and the time to the first plan.

    python -m tests.node exec -- python -m tests.bench.footprint [--seconds 20]

Installed by the chart, as users do, with TLS and roles; idle, and with an IMU at 200 Hz, a camera at 30 Hz and sound of
16 kHz through the router. CPU is reported beside its floor, which takes turns with it on the same traffic: a process
that only has a callback for the IMU, decoding and planning alone, and a router without TLS that only forwards. Needs
the image contextpolicy:dev on the node and to run as root there. Prints a table, writes build/bench/footprint.json.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
import zlib
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from contextpolicy.bus.session import open_visitor
from tests.bench.child import Child
from tests.bench.engine_measure import machine
from tests.bench.footprint import processes
from tests.bench.footprint.traffic import RATES, Traffic
from tests.bench.live_case import KEYS, steady_policy
from tests.bench.reaction import objects
from tests.bench.reaction.hearing import Hearing
from tests.bench.reaction.site import ADDRESSES, AGENT, Site, say
from tests.bench.reaction.stopwatch import Stopwatch
from tests.bench.results import keep
from tests.e2e.cluster import apply, get, run, secret_files, until
from tests.node.layout import CACHE
from timelines.demo.cgroup import find
from timelines.demo.deploy import free_address

PARTS = ("operator", "router", "agent")
TASKS = ("slam", "speech")
FLOOR = "tcp/127.0.0.1:17448"
SETTLING, PATIENCE = 5.0, 60.0
TURNS = 3
GOALS = {"footprint_mib": 200, "footprint_over_floor": 1.3, "image_mib": 150, "first_plan_s": 2.0}
MIB = 1 << 20


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each stretch (%(default)s)")
    parser.add_argument("--starts", type=int, default=5, help="of the operator (%(default)s)")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # as after Ctrl-C, nothing is left behind
    with Stopwatch() as stopwatch, Site(stopwatch) as site, ExitStack() as stack:
        result = {**_measure(site, stack, options), "machine": machine()}
    keep("footprint", result)
    print(_text(result))
    return 0


def _measure(site: Site, stack: ExitStack, options: argparse.Namespace) -> dict[str, Any]:
    address = free_address(ADDRESSES[AGENT])
    bus = site.operator(AGENT, agent=True)
    site.pods(AGENT, TASKS)
    plans = Hearing(bus, f"contextpolicy/{AGENT}/bench/plan")
    stack.callback(plans.close)
    apply(objects.policy_of(AGENT, _spec()))
    plans.wait(lambda plan: {target["task"] for target in plan["targets"]} == set(TASKS), 0.0, PATIENCE)
    directory = Path(stack.enter_context(TemporaryDirectory()))
    credentials = secret_files(f"{AGENT}-bus-module", AGENT, directory)
    module = stack.enter_context(open_visitor([f"tls/{address}:7447"], patience=20, credentials=credentials))
    floor = _Floor(stack)
    time.sleep(SETTLING)
    keys = {what: f"{AGENT}/{what}" for what in RATES}
    rows: dict[str, dict[str, list[float]]] = {part: {"idle": [], "busy": []} for part in (*PARTS, *floor.parts)}
    for turn in range(TURNS):
        say(f"turn {turn + 1} of {TURNS}")
        _note(rows, "idle", _cpu({**_pods(), **floor.parts}, options.seconds))
        with Traffic(bus, module, keys):
            _note(rows, "busy", _cpu(_pods(), options.seconds))
        with floor.traffic():
            _note(rows, "busy", _cpu(floor.parts, options.seconds))
    rows["planning"] = {"busy": [floor.planning() for _ in range(TURNS)]}
    memory = {part: round(processes.resident(process) / MIB, 1) for part, process in _pods().items()}
    with Traffic(bus, module, keys):  # a stream that nobody feeds is waited for until it is silent
        starts = [_first_plan(plans) for _ in range(options.starts)]
    return _summary(rows, memory, starts)


def _summary(rows: dict[str, dict[str, list[float]]], memory: dict[str, float], starts: list[float]) -> dict[str, Any]:
    cores = {part: {when: round(median(of) * 1e3, 1) for when, of in row.items() if of} for part, row in rows.items()}
    least = sum(row["busy"] for part, row in cores.items() if part not in PARTS)
    busy = sum(cores[part]["busy"] for part in PARTS)
    return {
        "footprint_mib": round(sum(memory.values()), 1),
        "footprint_over_floor": round(busy / least, 2),
        "image_mib": _image(),
        "first_plan_s": round(median(starts), 2),
        "memory_mib": memory,
        "millicores": cores,
        "first_plans_s": [round(seconds, 2) for seconds in starts],
        "shim_mib": round(processes.resident(processes.parent(_task())) / MIB, 1),
    }


def _spec() -> dict[str, Any]:
    """The live benchmark's policy, for our pods."""
    spec = steady_policy()["spec"]
    selectors = {name: objects.task(name)["selector"] for name in TASKS}
    return {
        **spec,
        "streams": [{**spec["streams"][0], "key": f"{AGENT}/imu"}],
        "tasks": [{**task, "selector": selectors[task["name"]]} for task in spec["tasks"]],
    }


class _Floor:
    """The least that could be there: a router that only forwards, and a callback."""

    def __init__(self, stack: ExitStack) -> None:
        router = stack.enter_context(Child("-m", "contextpolicy", "router", "--listen", FLOOR))
        bare = stack.enter_context(Child("-m", "tests.bench.live_subject", "bare", FLOOR))
        self._engine = stack.enter_context(Child("-m", "tests.bench.live_subject", "engine", FLOOR))
        self._sessions = [stack.enter_context(open_visitor([FLOOR], patience=5.0)) for _ in range(2)]
        self.parts = {"forwarding": router.process, "callback": bare.process}

    def traffic(self) -> Traffic:
        """The same samples."""
        sensors, module = self._sessions
        return Traffic(sensors, module, {"imu": KEYS["bare"], "camera": "bench/camera", "microphone": "bench/sound"})

    def planning(self) -> float:
        """Cores that decoding and planning take."""
        rate = RATES["imu"]
        return float(self._engine.ask(rate=rate, count=5 * rate)["us"]) * 1e-6 * rate


def _pods() -> dict[str, int]:
    """The process of each part."""
    found = {}
    for pod in json.loads(run("kubectl", "get", "pods", "-n", AGENT, "-o", "json"))["items"]:
        part = pod["metadata"]["labels"].get("app.kubernetes.io/component")
        if part in PARTS and "deletionTimestamp" not in pod["metadata"]:
            found[part] = _process(pod)
    return found


def _task() -> int:
    return _process(get("pod", TASKS[0], AGENT))


def _process(pod: dict[str, Any]) -> int:
    group = find(pod["status"]["containerStatuses"][0]["containerID"])
    assert group is not None, "this has to run on the node itself"
    return min(group.processes())


def _cpu(of: dict[str, int], seconds: float) -> dict[str, float]:
    """Cores that each process takes for so long."""
    before, began = {part: processes.cpu(process) for part, process in of.items()}, time.monotonic()
    time.sleep(seconds)
    spent = time.monotonic() - began
    return {part: (processes.cpu(process) - before[part]) / spent for part, process in of.items()}


def _note(rows: dict[str, dict[str, list[float]]], when: str, cores: dict[str, float]) -> None:
    for part, found in cores.items():
        rows[part][when].append(found)


def _first_plan(plans: Hearing) -> float:
    """Seconds from the start of a new operator's process until its first plan is on the bus."""
    before, at = _pods()["operator"], time.time()
    run("kubectl", "delete", "pod", "-n", AGENT, "-l", "app.kubernetes.io/component=operator", "--wait=false")
    until("another operator runs", lambda: _other_operator(before), PATIENCE)
    process = _pods()["operator"]
    heard, _ = plans.wait(lambda plan: plan["run"] / 1e3 > at, at, PATIENCE)
    time.sleep(SETTLING)
    return heard - processes.started(process)


def _other_operator(before: int) -> bool:
    try:
        return _pods().get("operator", before) != before
    except (KeyError, ValueError, AssertionError):  # it has no container yet
        return False


def _image() -> float:
    """MiB of the image as a registry has it: compressed. The node reports what it takes unpacked."""
    size, packer = 0, zlib.compressobj()
    [archive] = (CACHE / "images" / "contextpolicy").glob("*.tar")  # of the last build
    with archive.open("rb") as file:
        while block := file.read(MIB):
            size += len(packer.compress(block))
    return round((size + len(packer.flush())) / MIB, 1)


def _text(result: dict[str, Any]) -> str:
    lines = [str(result["machine"]), "", f"{'':12}{'MiB':>8}{'idle':>12}{'busy millicores':>18}"]
    for part, cores in result["millicores"].items():
        memory = result["memory_mib"].get(part, "")
        lines.append(f"{part:12}{memory:>8}{cores.get('idle', ''):>12}{cores['busy']:>18}")
    lines += ["", f"first plans after {result['first_plans_s']} s", f"a pod's shim: {result['shim_mib']} MiB", ""]
    lines += [f"{name:22} {result[name]!s:>8}   goal <= {goal}" for name, goal in GOALS.items()]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
