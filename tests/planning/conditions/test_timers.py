from __future__ import annotations

import random

from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.planning.conditions.timers import Timers


class Bell:
    """Notes when it rang, in a list that all bells of a test share."""

    def __init__(self, name: str, rung: list[tuple[str, float]]) -> None:
        self.name, self.rung = name, rung

    def on_due(self, now: float) -> None:
        self.rung.append((self.name, now))


def bells(*names: str) -> tuple[list[tuple[str, float]], list[Bell]]:
    rung: list[tuple[str, float]] = []
    return rung, [Bell(name, rung) for name in names]


def test_next_due_ignores_later_deadlines():
    _, (early, late) = bells("early", "late")
    timers = Timers()
    timers.set(early, 1.0)
    timers.set(late, 3.0)
    assert [timers.next_due(by) for by in (0.9, 1.0, 5.0)] == [None, 1.0, 1.0]
    timers.set(early, 4.0)
    assert [timers.next_due(by) for by in (2.9, 3.0, 5.0)] == [None, 3.0, 3.0]


def test_deadlines_act_in_order_and_once():
    rung, (early, late) = bells("early", "late")
    timers = Timers()
    timers.set(late, 2.0)
    timers.set(early, 1.0)
    assert timers.next_due() == 1.0
    timers.fire(5.0)
    timers.fire(6.0)
    assert [name for name, _ in rung] == ["early", "late"]


def test_one_instant_keeps_the_order_of_first_setting():
    rung, (first, second) = bells("first", "second")
    timers = Timers()
    timers.set(first, 9.0)
    timers.set(second, 1.0)
    timers.set(first, 1.0)
    timers.fire(1.0)
    assert [name for name, _ in rung] == ["first", "second"]


def test_a_due_timer_set_while_firing_fires_too():
    timers = Timers()
    rung: list[tuple[str, float]] = []
    after = Bell("after", rung)

    class Chain:
        def on_due(self, now: float) -> None:
            timers.set(after, now)

    timers.set(Chain(), 1.0)
    timers.fire(1.0)
    assert rung == [("after", 1.0)]


def test_moving_a_deadline_later_again_and_again_does_not_grow_the_heap():
    """What every sample does to its stream's watchdog."""
    _, (bell,) = bells("bell")
    timers = Timers()
    for tick in range(10_000):
        timers.set(bell, 1.0 + tick)
    assert len(timers._heap) == 1


def test_setting_and_clearing_again_and_again_does_not_grow_the_heap():
    """What a flapping condition does to its context's delay."""
    _, (bell,) = bells("bell")
    timers = Timers()
    for tick in range(10_000):
        timers.set(bell, 3600.0 + tick)
        timers.clear(bell)
    assert len(timers._heap) == 1
    assert timers.next_due() is None


def test_a_far_deadline_between_near_ones_does_not_grow_the_heap():
    """What a short and a long window of one stream do to their timer: the short one is empty again and again."""
    rung, (bell, idle) = bells("bell", "idle")
    timers = Timers()
    timers.set(idle, 3600.0)
    for tick in range(1000):
        timers.set(bell, tick + 0.5)
        timers.fire(tick + 0.5)
        timers.set(bell, 3601.0)
    assert len(timers._heap) <= 5
    assert timers.next_due() == 3600.0
    rung.clear()
    timers.fire(3601.0)
    assert rung == [("idle", 3601.0), ("bell", 3601.0)]
    assert timers._heap == []


@given(st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from(["set", "clear", "fire"]), st.integers(0, 9))))
def test_it_matches_a_simple_model(steps):
    compare(steps)


def test_it_matches_a_simple_model_over_many_steps():
    chance = random.Random(1)  # noqa: S311 - not a secret
    steps = ["set", "set", "set", "clear", "fire"]
    compare((chance.choice("abcdefgh"), chance.choice(steps), tick // 2 + chance.randrange(50)) for tick in range(2000))


def compare(steps):
    rung, all_bells = bells(*"abcdefgh")
    owners = dict(zip("abcdefgh", all_bells, strict=True))
    timers, table = Timers(), {}
    for name, step, when in steps:
        owner = owners[name]
        if step == "set":
            timers.set(owner, when)
            table[name] = when
        elif step == "clear":
            timers.clear(owner)
            table.pop(name, None)
        else:
            rung.clear()
            timers.fire(when)
            assert sorted(name for name, _ in rung) == sorted(name for name, due in table.items() if due <= when)
            table = {name: due for name, due in table.items() if due > when}
        assert timers.next_due() == min(table.values(), default=None)
