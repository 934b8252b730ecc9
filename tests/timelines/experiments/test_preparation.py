"""Loads, deadlines and static weights, from runs whose every figure is known."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.timelines.experiments.made_up import ABOUT, SCHEDULE, a_run, at_speed
from timelines.experiments.accounting import Ended, Ending
from timelines.experiments.calibration import capacity, deadline, demand, neediest, solo
from timelines.experiments.capacity import Capacity
from timelines.experiments.halving import ALWAYS, AROUND_KNOWN, AROUND_NEED, LEAST, MOST, candidates, halved, score
from timelines.experiments.metrics import Run
from timelines.experiments.prepare import priorities
from timelines.experiments.record import Column
from timelines.experiments.workbench import own_deadlines

PRIORITIES = {"slam": 3.0, "speech": 3.0, "navigation": 10.0, "host": 1.0}


def run(**endings):
    return Run(SCHEDULE, a_run("alone", **endings))


def alone(slam="i" * 10, cpu=0.02):
    """Its inputs come for ten of sixty seconds and cost 0.2 s; 0.3 s go into receiving them. It rests at 2 ms/s."""
    used = [0, *range(52, 521, 52), *range(522, 621, 2)]
    about = {**ABOUT, "seconds": 60.0, "cpu": {"slam": 0.62, "speech": 0.12}}
    resting = list(range(0, 121, 2))
    record = replace(a_run("alone", slam=slam, cpu=cpu), used={"slam": used, "speech": resting}, about=about)
    return Run(SCHEDULE, record)


def test_a_task_wants_what_it_used_while_its_inputs_came_and_no_rest_of_the_time():
    assert demand([alone(), alone()]) == pytest.approx({"slam": 0.052, "speech": 0.002})


def test_what_is_wanted_is_in_whole_processors_however_fast_they_were():
    one = alone()
    faster = Run(SCHEDULE, at_speed(one.record, 1.5))
    assert demand([faster]) == pytest.approx({name: 1.5 * cores for name, cores in demand([one]).items()})
    assert neediest([faster])["drive"] == pytest.approx(1.5 * neediest([one])["drive"])


def test_inputs_that_were_not_done_are_wanted_as_well():
    assert demand([alone(slam="i" * 5 + "d" * 5)])["slam"] == pytest.approx(0.052 + 0.01)


def test_the_fewest_processors_are_slowed_until_the_tasks_want_what_a_load_says():
    wanted = {"slam": 0.8, "signs": 0.32}
    assert [capacity(load, wanted, 3) for load in ("light", "heavy", "paper")] == [(2, 0.8), (1, 0.8), (1, 0.8)]
    assert capacity("heavy", {"slam": 0.1}, 2) == (1, 0.15)


def test_a_tenth_of_a_processor_is_not_worth_another_one_of_half_the_speed():
    assert capacity("heavy", {"slam": 1.5}, 3) == (1, 1.071)
    assert capacity("heavy", {"slam": 1.6}, 3) == (2, 0.571)


def test_on_all_processors_there_is_room_for_all_else():
    """As measured: else a load of 0.7 was one of 1.08, and nothing was light about it."""
    wanted = {"slam": 0.7, "signs": 0.28}
    assert capacity("light", wanted, 2) == (2, 1.2)  # (0.98 + 0.7) / 0.7
    assert capacity("light", wanted, 2, least=1.445) == (2, 1.2)  # 1.445 / 0.85, and 0.7
    assert capacity("light", wanted, 2, least=1.6) == (2, 1.25)  # a pace that limits still leave


def test_processors_are_not_asked_to_be_faster_than_they_are():
    assert [capacity(load, {"slam": 9.0}, 2) for load in ("light", "heavy")] == [(2, 1.25), (2, 1.25)]


def test_no_context_wants_more_for_its_critical_and_the_protected_tasks_than_there_is():
    """Nobody's division could keep a goal there: rather a smaller load than one of which nothing can be learned."""
    wanted = {"slam": 0.2, "signs": 0.2}
    assert capacity("heavy", wanted, 2, least=0.18) == (1, 0.286)  # 1.4 times
    assert capacity("heavy", wanted, 2, least=0.34) == (1, 0.4)  # 85 % of it


def test_what_a_context_needs_is_that_of_nearly_all_of_its_time():
    """SLAM's ten inputs are a second apart; two of the five while it drives cost more than the rest.

    Of what comes every 0.7 s one second has one, the next has two: so two of them count together.
    """
    costs = [0.1, 0.1, 0.1, 0.2, 0.4, *[0.02] * 5]
    slam = Column("d" * 10, [500] * 10, [round(cost * 100_000) for cost in costs])
    one = alone()
    about = {**one.record.about, "cpu": {"slam": 1.3, "speech": 0.32}}
    record = replace(one.record, columns={**one.record.columns, "slam": {"stereo": slam}}, about=about)
    beside = 0.12 - 0.1  # cores it wants, and those for its inputs
    assert neediest([Run(SCHEDULE, record)]) == pytest.approx({"drive": 0.3 + beside, "talk": 0.02 + 0.022 - 0.02})


def test_a_policy_divides_what_is_there():
    assert Capacity(1, 0.8).reserve(2, 1.0) == "1200m"  # all else runs on the other processor
    assert Capacity(2, 0.5).reserve(2, 1.0) == "1700m"  # all else is on the tasks' processors
    assert Capacity(2, 1.0).reserve(2, 1.0) == "700m"
    assert Capacity(2, 1.4).reserve(2, 2.0) == "950m"
    assert Capacity(2, 1.4).reserve(2, 1.0) == "0"  # more than whole ones
    assert (str(Capacity(1, 0.75)), Capacity(1, 0.75).name) == ("1 x 0.75", "1x0.75")


def ended(*responses):
    return [Ended(Ending.LATE, one, 0.01) for one in responses]


def test_a_deadline_is_doubled_until_the_task_keeps_it_alone_with_time_to_spare():
    assert deadline(0.1, ended(0.04, 0.05)) == 0.1
    assert deadline(0.1, ended(0.04, 0.06)) == 0.2
    assert deadline(0.1, ended(0.04, 0.2)) == 0.4
    assert deadline(0.1, ended(*[0.04] * 99, 0.06)) == 0.1
    assert deadline(0.1, ended(*[0.04] * 98, 0.06, 0.06)) == 0.2  # as many as a goal forgives
    assert deadline(0.1, ended(9.0)) == 0.4  # twice at most: it fails alone, and the report says so
    assert deadline(0.1, [*ended(0.05), Ended(Ending.DROPPED)]) == 0.1  # a longer one would bring nothing back
    assert solo(0.1, [*ended(0.05, 0.3), Ended(Ending.DROPPED)]) == pytest.approx(1 / 3)


def test_what_a_user_writes_at_once_is_tried_first_and_the_rest_is_always_the_same():
    found = candidates(PRIORITIES, {"slam": 0.8, "speech": 0.4}, {})
    assert found[0] == dict.fromkeys(PRIORITIES, 256)
    assert found[1] == {"slam": 307, "speech": 307, "navigation": 1024, "host": 102}
    assert found[2] == {"slam": 1024, "speech": 512, "navigation": LEAST, "host": LEAST}
    assert found[3] == {"slam": 1024, "speech": 512, "navigation": 1024, "host": LEAST}
    assert candidates(PRIORITIES, {"slam": 0.8, "speech": 0.4}, {}) == found
    assert all(LEAST <= weight <= MOST for one in found for weight in one.values())


def test_the_rest_is_drawn_around_what_the_tasks_need():
    """Sets that leave some task nothing are no opponent: each would fail in that task's context."""
    need = {"slam": 1024, "signs": 768, "speech": 192, "imu": 1024, "navigation": 1024, "arm": 48}
    wanted = {"slam": 0.2, "signs": 0.15, "speech": 0.0375, "imu": 0.08, "navigation": 0.01, "arm": 0.0094}
    drawn = candidates(dict.fromkeys(need, 1.0), wanted, {})[4 : 4 + AROUND_NEED]
    ratios = [weight / need[name] for one in drawn for name, weight in one.items()]
    assert 0.24 < min(ratios) < 0.5
    assert 2 < max(ratios) < 4.1


def test_a_user_who_knows_the_stories_leaves_next_to_nothing_to_tasks_that_are_never_critical():
    deadlines = {"imu": 0.1, "slam": 0.2, "signs": 2.0, "signs-left": 2.0}
    found = candidates(dict.fromkeys(deadlines, 1.0), {"slam": 0.4}, deadlines)[4 + AROUND_NEED :]
    assert found[0] == {"imu": 1024, "slam": 1024, "signs": 1024, "signs-left": LEAST}
    assert found[1 + AROUND_KNOWN] == {"imu": 1024, "slam": 512, "signs": 51, "signs-left": LEAST}
    assert len(found) == 2 * (1 + AROUND_KNOWN)
    assert all(one["signs-left"] < 10 < one["signs"] for one in found)


def test_no_two_of_them_are_the_same_in_the_stories_own_policy():
    wanted = {"slam": 0.2, "signs": 0.18, "imu": 0.07, "speech": 0.02, "navigation": 0.01}
    tries = candidates(priorities(), wanted, own_deadlines())
    shares = {tuple(round(weight / sum(one.values()), 3) for weight in one.values()) for one in tries}
    assert len(shares) == len(tries)


def test_weights_are_worth_their_worst_context():
    found = score([run(slam="iiiid" + "iiiii"), run(slam="iiidd" + "iiiii", speech="iiiii" + "ddddd")])
    assert found.worst == pytest.approx(0.5)  # speech, in one of two stories
    assert found.contexts == pytest.approx((0.7 + 0.5) / 2)


def test_the_best_go_on_after_each_story_and_the_simple_ones_always_do():
    tries = candidates(PRIORITIES, {"slam": 1.0}, {})
    played = []

    def play(number, weights, story):
        assert weights == tries[number]
        played.append((story, number))
        slam, speech = "i" if number == 9 else "d", "i" if number > 7 else "d"
        return run(slam=f"{slam}iiiiiiiii", speech=f"ddddd{5 * speech}")

    found = halved(tries, ["a", "b", "c", "d"], play)
    runs = {story: [number for name, number in played if name == story] for story in "abcd"}
    assert [len(runs[story]) for story in "abcd"] == [len(tries), 8 + ALWAYS, 4 + ALWAYS, 4 + ALWAYS]
    assert {0, 1} <= set(runs["d"])
    assert found[0].weights == tries[9]
    assert found[0].stories == 4
