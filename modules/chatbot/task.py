"""From what was said to what the robot answers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modules.chatbot.answers import answer
from modules.chatbot.memory import Memory, UnusableError
from robotkit import MessageError, Result, Task, json_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from robotkit import Received, Results


class Chatbot(Task):
    """Remembers messages about the robot, and answers questions from them."""

    def __init__(self) -> None:
        self._memory = Memory()

    def process(self, received: Received) -> Results:
        """Take one message; only a question has an answer."""
        message = _object(received.payload)
        at = received.stamp / 1e9
        try:
            match received.input:
                case "pose":
                    self._memory.see_pose(message, at)
                case "plan":
                    self._memory.see_plan(message, at)
                case "health":
                    self._memory.see_health(received.key.split("/")[-2], message, at)
                case _:
                    return self._answer(message, at)
        except UnusableError as error:
            raise MessageError(str(error)) from error
        return None

    def _answer(self, message: Mapping[str, object], at: float) -> list[Result]:
        question = message.get("text")
        if not isinstance(question, str):
            raise MessageError(f"a transcript without a text: {message}")
        if not question.strip() or not message.get("final", True):
            return []
        return [Result("answer", {"question": question, "text": answer(question, self._memory, at)})]


def _object(payload: bytes) -> Mapping[str, object]:
    try:
        message = json_text.loads(payload)
    except ValueError as error:
        raise MessageError(f"not JSON: {error}") from error
    if not isinstance(message, dict):
        raise MessageError(f"not an object: {payload[:40]!r}")
    return message
