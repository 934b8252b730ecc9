"""A stream is gone with its last sender, in whatever order tokens and answers arrive."""

from __future__ import annotations

from itertools import permutations
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from contextpolicy.streams.senders import LONGEST, MOST, Senders


def found(**fields) -> Any:
    """Stands for a reply or a sample of Zenoh's, which nobody can make."""
    return SimpleNamespace(**fields)


class Story:
    """What happens by name: `+left` and `-left` are tokens, `left` an answer, and `.` the end of answers."""

    def __init__(self, steps):
        self.gone = 0
        senders = Senders(self)
        for step in steps:
            key = step.lstrip("+-")
            if step == ".":
                senders.on_end()
            elif step == key:
                senders.on_answer(found(ok=found(key_expr=key)))
            else:
                kind = zenoh.SampleKind.PUT if step.startswith("+") else zenoh.SampleKind.DELETE
                senders.on_token(found(key_expr=key, kind=kind))

    def on_gone(self):
        self.gone += 1


def orders(*steps):
    """All in which answers come before their end."""
    return [order for order in permutations(steps) if _is_possible(order)]


def _is_possible(steps):
    return all(steps.index(".") > index for index, step in enumerate(steps) if step[0] not in "+-.")


@pytest.mark.parametrize("steps", orders("left", "right", ".", "-left"))
def test_a_stream_is_not_gone_while_one_sender_remains(steps):
    assert Story(steps).gone == 0
    assert Story([*steps, "-right"]).gone == 1


@pytest.mark.parametrize("steps", orders("left", "right", ".", "-left", "-right"))
def test_a_stream_is_gone_when_both_senders_end(steps):
    assert Story(steps).gone == 1


@pytest.mark.parametrize(
    "steps", [["."], ["+left", "."], ["left", "."], [".", "+left"], ["-left", "+left", "left", "."]]
)
def test_a_live_sender_is_not_reported_gone(steps):
    assert Story(steps).gone == 0
    assert Story([*steps, "+left", "-left"]).gone == 1


def test_a_returned_sender_can_end_again():
    assert Story([".", "+left", "-left", "+left", "-left"]).gone == 2


def test_an_error_answer_is_ignored():
    senders = Senders(story := Story(["."]))
    senders.on_answer(found(ok=None))
    senders.on_token(found(key_expr="left", kind=zenoh.SampleKind.DELETE))
    senders.on_end()
    assert story.gone == 1


def test_a_token_with_an_overlong_key_is_ignored():
    endless = "x" * (LONGEST + 1)
    assert Story([".", "+left", f"+{endless}", "-left"]).gone == 1
    assert Story([".", f"+{endless}", f"-{endless}"]).gone == 0
    assert Story([endless, f"-{endless}", "."]).gone == 0


def test_the_number_of_tokens_is_bounded():
    many = [f"+{number}" for number in range(2 * MOST)]
    ends = [step.replace("+", "-") for step in many]
    assert Story([".", *many, *ends[:MOST]]).gone == 1
    assert Story([".", *many, *ends, "+left", "-left"]).gone == 2
    assert Story([*ends, ".", "+left"]).gone == 1
