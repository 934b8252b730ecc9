"""All actuators of an operator behind one contract: who acts in which mode, and what each of them hears."""

from __future__ import annotations

from typing import Any

from contextpolicy.actuators.actuator import Actuators
from contextpolicy.actuators.idle import Idle
from contextpolicy.actuators.order import Order
from contextpolicy.policy.spec import Mode

POLICY = "lab/robot"


class Noting:
    """Notes what it hears, in a list that it may share; a release is done when the test says so."""

    def __init__(self, name, notes):
        self._name, self._notes = name, notes
        self.done = None

    def recall(self, policy, stored):
        self._note("recall", policy, stored)

    def apply(self, order):
        self._note("apply", order)

    def release(self, policy, done):
        self._note("release", policy)
        self.done = done

    def abandon(self, policy):
        self._note("abandon", policy)

    def observe(self, pod):
        self._note("observe", pod)

    def forget(self, uid):
        self._note("forget", uid)

    def _note(self, *what):
        self._notes.append((self._name, *what))


def made():
    notes: list[tuple[Any, ...]] = []
    resizer, dry_run = Noting("resizer", notes), Noting("dry run", notes)
    return notes, resizer, dry_run, Actuators({Mode.ENFORCE: resizer, Mode.DRY_RUN: dry_run, Mode.PAUSED: Idle()})


NOTHING = Order(POLICY, frozenset())


def test_a_mode_has_its_actuator_and_the_others_put_back_what_they_changed():
    notes, resizer, dry_run, actuators = made()
    assert actuators.of(Mode.DRY_RUN) is dry_run
    actuators.put_back_others(POLICY, Mode.DRY_RUN)
    assert notes == [("resizer", "apply", NOTHING)]
    notes.clear()
    assert actuators.of(Mode.ENFORCE) is resizer
    actuators.put_back_others(POLICY, Mode.ENFORCE)
    assert notes == [("dry run", "apply", NOTHING)]


def test_a_paused_policy_has_an_idle_actuator_and_gets_everything_back():
    notes, _, _, actuators = made()
    assert isinstance(actuators.of(Mode.PAUSED), Idle)
    actuators.put_back_others(POLICY, Mode.PAUSED)
    assert notes == [("resizer", "apply", NOTHING), ("dry run", "apply", NOTHING)]


def test_pod_and_policy_events_reach_every_actuator():
    notes, _, _, actuators = made()
    actuators.recall(POLICY, {"uid-1": {}})
    actuators.observe("a pod")
    actuators.forget("uid-1")
    actuators.abandon(POLICY)
    heard: list[tuple[Any, ...]] = [
        ("recall", POLICY, {"uid-1": {}}),
        ("observe", "a pod"),
        ("forget", "uid-1"),
        ("abandon", POLICY),
    ]
    assert notes == [(name, *what) for what in heard for name in ("resizer", "dry run")]


def test_a_policy_is_released_when_every_actuator_has_let_go():
    notes, resizer, dry_run, actuators = made()
    done: list[bool] = []
    actuators.release(POLICY, lambda: done.append(True))
    assert notes == [("dry run", "release", POLICY)]
    dry_run.done()
    assert notes[1:] == [("resizer", "release", POLICY)]
    assert done == []
    resizer.done()
    assert done == [True]
