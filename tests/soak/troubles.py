"""What others do to a robot during a soak: each is over by itself, and none moves a limit to what no plan gives."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

from contextpolicy.bus.decision_bus import plan_key
from tests.e2e.cluster import apply, delete, get, run
from tests.e2e.robot import pod, policy, task
from tests.e2e.test_floods import FLOODS, flood

if TYPE_CHECKING:
    from collections.abc import Callable

    import zenoh

    from tests.e2e.robot import Robot
    from tests.e2e.slow_link import SlowLink

DELAY, SLOW, FLOOD = 5.0, 8.0, 3.0
"""Seconds that the API server takes for an answer, for how long, and for how long a sender floods."""
CROWD = 30


class Troubles:
    """`original` gives the limit that a task's container came with, in thousandths of a core."""

    def __init__(
        self, robot: Robot, session: zenoh.Session, link: SlowLink, original: Callable[[str], int | None]
    ) -> None:
        self._robot, self._session, self._link, self._original = robot, session, link, original
        self.had: list[str] = []

    def have(self, kind: str, name: str) -> None:
        """One of `story.TROUBLES`; CommandError where a part that it takes is away."""
        getattr(self, f"_{kind.replace(' ', '_').lower()}")(name)
        self.had.append(kind)

    def _slow_api(self, _: str) -> None:
        """For the operator alone."""
        self._link.delay = DELAY
        time.sleep(SLOW)
        self._link.delay = 0.0

    def _flood(self, name: str) -> None:
        names = sorted(FLOODS)
        encoding, size, rate, keys = FLOODS[names[len(self.had) % len(names)]]
        with flood(f"{self._robot.namespace}/loud/{name}", encoding, size, rate, keys):
            time.sleep(FLOOD)

    def _forged_originals(self, name: str) -> None:
        uid = self._uid(name)
        self._patch({uid: {"containers": {name: {"request": "10m", "limit": "50m"}}}})

    def _emptied_originals(self, _: str) -> None:
        self._patch(dict.fromkeys(self._robot.status().get("originals") or {}))

    def _uid(self, name: str) -> str:
        uid: str = get("pod", member(name), self._robot.namespace)["metadata"]["uid"]
        return uid

    def _patch(self, originals: dict[str, Any]) -> None:
        how = ("--subresource=status", "--type=merge", "-p", json.dumps({"status": {"originals": originals}}))
        run("kubectl", "patch", "ctxp", "robot", "-n", self._robot.namespace, *how, timeout=20)

    def _foreign_resize(self, name: str) -> None:
        """To what the container came with, which is a limit that it may have; no pod that has replaced it."""
        uid = self._uid(name)
        limit = {"limits": {"cpu": f"{self._original(name)}m"}}
        patch = {"metadata": {"uid": uid}, "spec": {"containers": [{"name": name, "resources": limit}]}}
        where = ("-n", self._robot.namespace, "--subresource", "resize", "--field-manager", "vpa-updater")
        run("kubectl", "patch", "pod", member(name), *where, "--patch", json.dumps(patch), timeout=20)

    def _forged_plan(self, name: str) -> None:
        """On a bus that is open; without agents plans move nothing."""
        key = plan_key(self._robot.namespace, "robot")
        for where in (key, "*/*/*/plan", "**"):
            self._session.put(where, json.dumps({"sequence": 10**6, "targets": [{"task": name, "cores": 0.01}]}))
        self._session.delete(key)

    def _debugger(self, name: str) -> None:
        how = ("--image=contextpolicy:dev", "--image-pull-policy=IfNotPresent", "--", "sleep", "5")
        run("kubectl", "debug", member(name), "-n", self._robot.namespace, *how, timeout=20)

    def _crowd(self, name: str) -> None:
        """Pods that no node takes come and go; they match a task's selector."""
        crowd = [pod(f"crowd-{number}", self._robot.namespace, ["true"], None) for number in range(CROWD)]
        for one in crowd:
            one["metadata"]["labels"] = {"app": name, "crowd": "yes"}
            one["spec"]["nodeSelector"] = {"nobody": "has"}
        try:
            apply(*crowd)
        finally:
            self.clear()

    def _large_policy(self, _: str) -> None:
        """It has no pods, and comes while others decide."""
        large = policy(self._robot.namespace, "large", tasks=[task("nobody")], contexts=[])
        large["metadata"]["annotations"] = {"filling": "x" * 200_000}
        try:
            run("kubectl", "apply", "--server-side", "-f", "-", stdin=json.dumps(large), timeout=20)
            time.sleep(2)
        finally:
            delete("ctxp", "large", self._robot.namespace)

    def clear(self) -> None:
        """Take away what is left; CommandError where the API is away."""
        gone = ("-l", "crowd=yes", "--force", "--grace-period=0", "--wait=false")
        run("kubectl", "delete", "pods", "-n", self._robot.namespace, *gone, timeout=60)


def member(task: str) -> str:
    """The pod of a task's StatefulSet."""
    return f"{task}-0"
