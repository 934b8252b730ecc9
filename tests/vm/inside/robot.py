"""A robot in the machine: two pods, a sensor that speaks seldom, and what the kernel gives them."""

from __future__ import annotations

from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from tests.e2e.cluster import NO_RESIZES, refusal_of_resizes, until
from tests.e2e.robot import IDLE, pod, policy
from tests.vm.chart import ROBOT
from tests.vm.inside import api
from tests.vm.inside.files import limit, scope

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.e2e.robot import Sensors

POLICIES = "contextpolicy.dev/v1alpha1/contextpolicies"
ADMISSION = "admissionregistration.k8s.io/v1"
TASKS = ("slam", "speech")
STANDING, MOVING = {"slam": 200, "speech": 200}, {"slam": 390, "speech": 10}
STREAM = {"name": "imu", "key": f"{ROBOT}/imu", "staleAfter": "60s"}


def start(*names: str, namespace: str = ROBOT, resources: dict[str, Any] | None = None) -> None:
    """Start pods and wait until they run."""
    api.apply(*(pod(name, namespace, IDLE, resources) for name in names))
    for name in names:
        until(f"pod {name} is ready", partial(ready, name, namespace))


def ready(name: str, namespace: str) -> object:
    """True, or what the pod's status says instead."""
    status = api.get("pods", name, namespace)["status"]
    conditions = {one["type"]: one["status"] for one in status.get("conditions", [])}
    return True if conditions.get("Ready") == "True" else status


def govern(**changes: Any) -> None:
    """Apply the robot's policy, with some fields of its spec changed: of one core it divides 0.4.

    The node reserves 0.2 for the system, as config/k3s/config.yaml says, and the policy 0.4 for its own machinery.
    """
    api.apply(policy(ROBOT, **{"streams": [STREAM], "reserve": "400m", **changes}))


def drive(sensors: Sensors, speed: float | None) -> None:
    """The IMU says that the robot moves at `speed` m/s; None silences it."""
    sensors.read(f"{ROBOT}/imu", None if speed is None else {"speed": speed})


def limits() -> dict[str, str]:
    """What the kernel enforces, as cpu.max says it."""
    return {name: limit(scope(name, ROBOT)) for name in TASKS}


def api_limits() -> dict[str, str]:
    """What the API has."""
    return {name: api.get("pods", name, ROBOT)["spec"]["containers"][0]["resources"]["limits"]["cpu"] for name in TASKS}


def in_force(**cores: int) -> None:
    """Wait until the kernel enforces these limits, in thousandths of a core."""
    wanted = {name: f"{amount * 100} 100000" for name, amount in cores.items()}
    groups = {name: scope(name, ROBOT) for name in cores}

    def seen() -> object:
        now = {name: limit(group) for name, group in groups.items()}
        return True if now == wanted else now

    until(f"the kernel enforces {wanted}", seen)


def agreed(**cores: int) -> None:
    """Wait until the API has these limits too, and the kernel still."""
    wanted = {name: f"{amount}m" for name, amount in cores.items()}
    until(f"the API has {wanted}", lambda: True if api_limits() == wanted else api_limits())
    in_force(**cores)


def condition(kind: str) -> tuple[str, str]:
    """Status and message of a condition of the policy."""
    found = api.get(POLICIES, "robot", ROBOT).get("status", {}).get("conditions", [])
    return next(((one["status"], one["message"]) for one in found if one["type"] == kind), ("", ""))


def let_go() -> None:
    """Delete the policy and wait until it is gone, which it is when everything is as it was."""
    api.delete(POLICIES, "robot", ROBOT)
    until("the policy is gone", lambda: not api.exists(POLICIES, "robot", ROBOT))


@contextmanager
def resizes_refused() -> Iterator[None]:
    """While this holds the API server refuses to resize the robot's pods."""
    api.apply(*refusal_of_resizes(ROBOT))
    try:
        until("the API refuses resizes", lambda: NO_RESIZES in api.try_resize("slam", ROBOT))
        yield
    finally:
        for plural in ("validatingadmissionpolicybindings", "validatingadmissionpolicies"):
            api.delete(f"{ADMISSION}/{plural}", NO_RESIZES, "")
        until("the API takes resizes again", lambda: not api.try_resize("slam", ROBOT) or False)
