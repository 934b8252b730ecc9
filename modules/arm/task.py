"""Moves the arm: orders in, state out."""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING

from modules.arm.controller import Controller
from modules.arm.motion import STEP_S, stepped
from modules.arm.orders import Order, parse_order
from modules.arm.servos import BAUD
from robotkit import DeviceError, Result, Task
from robotkit.line import open_line

if TYPE_CHECKING:
    from collections.abc import Generator

    from modules.arm.joints import Arm, Posture
    from robotkit import Decision, Received

PORT = "/dev/ttyACM0"
REPORT_EVERY = 5
"""Steps from one state to the next while the arm moves."""
IDLE_S = 1.0
"""Seconds between checks that an idle arm is still connected."""

_LOG = logging.getLogger(__name__)


class MeArm(Task):
    """One arm on one serial line.

    It moves in steps of 50 ms, and nothing is sent ahead: to stop, it is enough to send no further step. So the arm
    also stops, within one step, when this process is starved, frozen or killed.
    """

    def __init__(self, arm: Arm, port: str = PORT) -> None:
        self._arm = arm
        self._port = port
        self._lock = threading.Lock()
        self._changed = threading.Event()
        self._controller: Controller | None = None
        self._posture = arm.posture_at(arm.home, grip=arm.joints["grip"].angle[0])
        self._goal: Posture | None = None
        self._doing = "resting"

    def process(self, received: Received) -> None:
        """Take an order."""
        with self._lock:
            if self._controller is None:
                raise DeviceError(f"{self._port}: no arm is connected to carry out an order")
            order = parse_order(received.payload, self._arm, self._goal or self._posture)
            if isinstance(order, Order):
                self._end("stopped" if order is Order.STOP else "relaxed")
                if order is Order.RELAX:
                    self._controller.relax()
            else:
                self._goal, self._doing = order, "moving"
        self._changed.set()

    def adapt(self, decision: Decision) -> None:
        """Stop when suspended; the servos hold the posture."""
        if decision.suspended:
            self._stop("suspended")

    def close(self) -> None:
        """Stop; the servos hold the posture."""
        self._stop("closed")

    def produce(self, ended: threading.Event) -> Generator[Result, None, None]:
        """Move towards the goal, step by step, until `ended` is set, or DeviceError."""
        with open_line(self._port, BAUD) as line:
            controller = Controller(line, self._arm)
            if not self._take(controller, ended):
                return
            try:
                yield from self._work(controller, ended)
            finally:
                self._let_go(controller, "suspended" if ended.is_set() else "unplugged")

    def _take(self, controller: Controller, ended: threading.Event) -> bool:
        """Make it the arm that orders are for, unless the task was suspended while its line was being opened."""
        controller.start()
        posture = controller.posture()
        with self._lock:
            if ended.is_set():  # by now another thread may have an arm
                return False
            self._posture = posture or self._posture  # unknown: the first move starts with a jump, see README.md
            self._controller = controller
        _LOG.info("%s: Maestro connected, its servos %s", self._port, "hold" if posture else "are limp")
        return True

    def _let_go(self, controller: Controller, why: str) -> None:
        with self._lock:
            if self._controller is controller:  # else another thread has one since
                self._controller = None
                self._end(why)

    def _work(self, controller: Controller, ended: threading.Event) -> Generator[Result, None, None]:
        step = 0
        while not ended.wait(STEP_S):
            moving = self._step(controller)
            step += 1
            if moving and step % REPORT_EVERY == 0:
                yield Result("state", self._state())
            if not moving:
                yield Result("state", self._state() | {"errors": controller.errors()})
                self._rest(controller, ended)
                step = 0

    def _step(self, controller: Controller) -> bool:
        """Take one step; returns whether more are to come."""
        with self._lock:
            if self._goal is None:
                return False
            self._posture = stepped(self._arm, self._posture, self._goal)
            controller.move(self._posture)
            if self._posture == self._goal:
                self._end("arrived")
            return self._goal is not None

    def _rest(self, controller: Controller, ended: threading.Event) -> None:
        """Wait for an order, asking for errors meanwhile, which raises DeviceError if the arm is unplugged."""
        while not ended.is_set() and not self._changed.wait(IDLE_S):
            controller.errors()
        self._changed.clear()

    def _stop(self, why: str) -> None:
        with self._lock:
            self._end(why)
        self._changed.set()

    def _end(self, why: str) -> None:
        self._goal, self._doing = None, why

    def _state(self) -> dict[str, object]:
        return {
            "doing": self._doing,
            "position": [round(value, 1) for value in self._arm.grip_at(self._posture)],
            "joints": {name: round(angle, 1) for name, angle in self._posture.items()},
        }
