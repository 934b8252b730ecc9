"""What a recording consists of, whatever its file format: topics, and the messages on them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from contextpolicy.errors import ContextPolicyError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence


class RecordingError(ContextPolicyError):
    """A recording that can't be read."""


class Topic(NamedTuple):
    """One topic of a recording. `encoding` is MCAP's word: cdr, json, cbor and so on; `type` is empty if unknown.

    Of ROS topics also what the recording has of them, empty if nothing: `hash` is the type's (RIHS01_...), `definition`
    its .msg text with all that it contains, `qos` the offered profiles as rosbag2 writes them, a YAML list.
    """

    name: str
    encoding: str
    type: str
    messages: int
    hash: str = ""
    definition: str = ""
    qos: str = ""


class Recorded(NamedTuple):
    """One message; `at` is in ns since 1970, or of simulated time."""

    at: int
    topic: str
    payload: bytes


class Recording(Protocol):
    """An open recording; `begin` and `end` are the times of its first and last message, in ns."""

    topics: dict[str, Topic]
    begin: int
    end: int

    def messages(self, topics: Iterable[str], begin: int, end: int) -> Iterator[Recorded]:
        """The messages of these topics from `begin` to `end`, both included, in the order of their times."""


class Damage(NamedTuple):
    """What is wrong with a part of a file, and what repairs it, each the end of a sentence."""

    path: str
    what: str
    repair: str
    read: str = ""
    """How much of it was read."""

    def __str__(self) -> str:
        read = self.read or "nothing was read"
        return f"{self.path} {self.what}; {read}; {self.repair}, and --skip-damaged continues without the damaged part"


class Damages(Protocol):
    """Receives each part that can't be read."""

    @property
    def notes(self) -> Sequence[str]:
        """A sentence for each part that was left out."""

    def add(self, damage: Damage) -> None:
        """Note it, and let reading go on behind it; RecordingError ends reading."""


class NoDamage:
    """Ends reading at the first damage, so that there is none to note."""

    notes: Sequence[str] = ()

    def add(self, damage: Damage) -> None:
        """Refuse the recording."""
        raise RecordingError(str(damage))


NO_DAMAGE = NoDamage()


def amount(messages: int, begin: int, end: int) -> str:
    """How much was read: how many messages, and the seconds that they span; times are in ns."""
    seconds = max(end - begin, 0) / 1e9 if messages else 0.0
    return f"{messages} {'message was' if messages == 1 else 'messages were'} read, over {seconds:.3f} s"


def ros_type(name: str) -> str:
    """`sensor_msgs/Imu` as `sensor_msgs/msg/Imu`; other names as they are."""
    package, slash, kind = name.partition("/")
    return f"{package}/msg/{kind}" if slash and "/" not in kind else name
