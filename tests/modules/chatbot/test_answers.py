"""What the robot answers, from messages as the bus carries them."""

from __future__ import annotations

import json

import pytest

from modules.chatbot.answers import answer
from modules.chatbot.memory import Memory
from modules.chatbot.task import Chatbot
from robotkit import MessageError, Received

S = 1_000_000_000


def plan(sequence, tasks, contexts=(), cause="start", mode="Enforce"):
    return {
        "policy": "robot/delivery-robot",
        "run": 1,
        "sequence": sequence,
        "mode": mode,
        "cause": cause,
        "contexts": list(contexts),
        "tasks": {
            name: {"share": share, "weight": share, "suspended": bool(because), "because": because or "priority 10"}
            for name, (share, because) in tasks.items()
        },
    }


BOTH = {"slam": (0.85, ""), "speech": (0.85, "")}
MOVING = {"slam": (1.69, ""), "speech": (0.01, "context moving suspends it")}


@pytest.fixture
def chatbot():
    return Chatbot()


def send(chatbot, name, message, at, key=""):
    payload = json.dumps(message).encode()
    return chatbot.process(Received(payload, round(at * S), 0, name, "json", "", key))


def ask(chatbot, text, at):
    (result,) = send(chatbot, "question", {"text": text, "final": True}, at)
    assert result.value["question"] == text
    return result.value["text"]


def test_where_are_you(chatbot):
    send(chatbot, "pose", {"position": [3.0, -4.0, 0.0], "inliers": 200}, 10)
    assert ask(chatbot, "where are you", 11) == (
        "I am at x 3.0, y -4.0, z 0.0 metres from where I started, 5.0 metres away."
    )


def test_an_old_place_is_called_old(chatbot):
    send(chatbot, "pose", {"position": [0, 0, 0]}, 10)
    assert "but that was 30 seconds ago" in ask(chatbot, "Where are you?", 40)


def test_a_lost_robot_says_so(chatbot):
    assert "do not know" in ask(chatbot, "where are you now", 1)
    send(chatbot, "pose", {"position": [0, 0, 0], "inliers": 0}, 10)
    assert "lost my way" in ask(chatbot, "where are you", 10)


def test_what_are_you_doing(chatbot):
    send(chatbot, "plan", plan(1, MOVING, ["moving"]), 5)
    assert ask(chatbot, "what are you doing", 6) == "Context moving: I run slam with 1.69 cores. Paused: speech."


def test_a_past_pause_is_explained(chatbot):
    send(chatbot, "plan", plan(1, BOTH), 0)
    send(chatbot, "plan", plan(2, MOVING, ["moving"], "imu: context moving entered"), 10)
    send(chatbot, "plan", plan(3, MOVING, ["moving"], "mic: level"), 12)
    send(chatbot, "plan", plan(4, BOTH, cause="imu: context moving exited"), 21)
    assert ask(chatbot, "why did you stop listening", 25) == (
        "speech was paused from 15 seconds ago until 4 seconds ago, because context moving suspends it."
        " It began with: imu: context moving entered."
    )


@pytest.mark.parametrize(
    "question", ["why are you not listening", "why is speech suspended", "why have you stopped hearing"]
)
def test_a_current_pause_is_explained(chatbot, question):
    send(chatbot, "plan", plan(1, MOVING, ["moving"]), 10)
    assert ask(chatbot, question, 13).startswith("speech has been paused for 3 seconds, because context moving")


def test_a_task_that_never_paused_is_stated(chatbot):
    send(chatbot, "plan", plan(1, BOTH), 0)
    assert ask(chatbot, "why did you stop listening", 1).startswith("I did not stop: speech has 0.85 cores")


def test_an_unknown_task_is_answered_with_known_ones(chatbot):
    send(chatbot, "plan", plan(1, BOTH), 0)
    assert ask(chatbot, "why did you stop dancing", 1) == 'I have no task for "dancing". I know slam and speech.'


def test_how_are_you(chatbot):
    assert "do not know" in ask(chatbot, "how are you", 1)
    send(chatbot, "health", {"misses": 0.25}, 2, "robot/slam/health")
    send(chatbot, "health", {"misses": 0.0}, 2, "robot/speech/health")
    assert ask(chatbot, "how are you", 3) == "Not so well: slam is late with 25% of its work."
    send(chatbot, "health", {"misses": 0}, 3, "robot/slam/health")
    assert ask(chatbot, "how are you", 4) == "I am well: slam and speech are on time."


def test_older_plans_and_dry_runs_are_ignored(chatbot):
    send(chatbot, "plan", plan(5, BOTH), 0)
    send(chatbot, "plan", plan(4, MOVING), 1)
    send(chatbot, "plan", plan(6, MOVING, mode="DryRun"), 2)
    assert "I run slam with 0.85 cores and speech with 0.85 cores." in ask(chatbot, "what are you doing", 3)


def test_an_unclear_question_is_answered_with_help():
    assert answer("", Memory(), 0).startswith("I did not understand")
    assert "Ask me where I am" in answer("sing a song", Memory(), 0)


def test_an_unfinished_transcript_is_not_a_question(chatbot):
    assert send(chatbot, "question", {"text": "where are", "final": False}, 1) == []


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("pose", {"position": [1, 2]}),
        ("pose", {"position": "here"}),
        ("plan", {"tasks": []}),
        ("plan", {"run": 1, "sequence": 1, "mode": "Enforce", "tasks": [1]}),
        ("health", {}),
        ("question", {"text": 7}),
        ("question", [1]),
    ],
)
def test_a_broken_message_is_refused(chatbot, name, message):
    with pytest.raises(MessageError):
        send(chatbot, name, message, 1, "robot/slam/health")
