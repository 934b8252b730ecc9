"""From the lidar's bytes to full turns."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from modules.lidar.rplidar import (
    CABINS,
    CAPSULE_SIZE,
    FULL_TURN,
    NODE_SIZE,
    Node,
    capsule_nodes,
    decode_capsule,
    decode_node,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from modules.lidar.rplidar import Capsule

BINS = 360
HALF_BIN = FULL_TURN / BINS / 2
_ZERO = Node(0.0, 0.0, 0)
RUN = 4
"""Nodes in a row that must fit together before the parser trusts that it reads at the right byte."""
LEAST_STEP, GREATEST_STEP = -5.0, 20.0
"""Degrees from one node to the next; anything else means that bytes are missing."""
FEWEST_NODES = 20
"""A turn with fewer is jitter around the angle at which turns begin."""


class Turn(NamedTuple):
    """A full turn; `later` is how many nodes were measured after its last one and are known already."""

    nodes: list[Node]
    later: int


class ScanParser(Protocol):
    """Turns bytes that arrive in pieces of any size into nodes."""

    skipped: int

    @property
    def held(self) -> int:
        """How many nodes have arrived and are not returned yet."""

    def feed(self, data: bytes) -> list[Node]:
        """Take the next bytes and return the nodes that are complete now."""

    def forget(self) -> None:
        """Forget what is incomplete: bytes are missing."""


class NodeParser:
    """Standard scan data. Nodes have no checksum: after a gap, only a run of nodes that fit together is believed."""

    def __init__(self) -> None:
        self.skipped = 0
        self._buffer = bytearray()
        self._last: Node | None = None

    @property
    def held(self) -> int:
        """How many nodes have arrived and are not returned yet."""
        return len(self._buffer) // NODE_SIZE

    def feed(self, data: bytes) -> list[Node]:
        """Take the next bytes and return the nodes that are complete now; `skipped` counts the bytes of none."""
        self._buffer += data
        nodes: list[Node] = []
        at = 0
        while len(self._buffer) - at >= NODE_SIZE * (1 if self._last else RUN):
            found = self._next(at)
            if found:
                nodes.append(found)
                at += NODE_SIZE
            elif self._last is None:
                at += 1
                self.skipped += 1
            self._last = found
        del self._buffer[:at]
        return nodes

    def forget(self) -> None:
        """Forget what is incomplete: bytes are missing."""
        self._buffer.clear()
        self._last = None

    def _next(self, at: int) -> Node | None:
        """Return the node at this byte if it fits its predecessor, or, when there is none, its successors."""
        node = self._node(at)
        if node is None or (self._last is not None and not _fits(self._last, node)):
            return None
        return node if self._last is not None or self._leads_a_run(node, at) else None

    def _leads_a_run(self, node: Node, at: int) -> bool:
        for successor in range(1, RUN):
            following = self._node(at + successor * NODE_SIZE)
            if following is None or not _fits(node, following):
                return False
            node = following
        return True

    def _node(self, at: int) -> Node | None:
        node = decode_node(bytes(self._buffer[at : at + NODE_SIZE]))
        return None if node and node.start and not _fits(_ZERO, node) else node


class CapsuleParser:
    """Express scan data: capsules have a checksum. A lost one costs its predecessor too, whose angles need it."""

    def __init__(self) -> None:
        self.skipped = 0
        self._buffer = bytearray()
        self._last: Capsule | None = None

    @property
    def held(self) -> int:
        """How many nodes have arrived and are not returned yet: those of the last capsule."""
        return 2 * CABINS if self._last else 0

    def feed(self, data: bytes) -> list[Node]:
        """Take the next bytes and return the nodes whose angles are known now."""
        self._buffer += data
        nodes: list[Node] = []
        while len(self._buffer) >= CAPSULE_SIZE:
            capsule = decode_capsule(bytes(self._buffer[:CAPSULE_SIZE]))
            if capsule is None:
                del self._buffer[0]
                self.skipped += 1
            else:
                nodes += capsule_nodes(self._last, capsule) if self._last and not capsule.start else []
                del self._buffer[:CAPSULE_SIZE]
            self._last = capsule
        return nodes

    def forget(self) -> None:
        """Forget what is incomplete: bytes are missing."""
        self._buffer.clear()
        self._last = None


class Turns:
    """Collects nodes into full turns, which begin at the angle `front`; nodes before the first turn are dropped.

    A turn with a gap is counted in `lost` and dropped: missing nodes would look like free space.
    """

    def __init__(self, front: float = 0.0) -> None:
        self.lost = 0
        self._front = front % FULL_TURN
        self._nodes: list[Node] = []
        self._begun = False
        self._whole = True

    def add(self, nodes: Sequence[Node]) -> list[Turn]:
        """Take the next nodes and return the turns that they complete."""
        turns = []
        for index, node in enumerate(nodes):
            follows = not self._nodes or _fits(self._nodes[-1], node)
            self._whole = self._whole and follows
            if self._ends_at(node):
                if self._begun and self._whole:
                    turns.append(Turn(self._nodes, len(nodes) - index))
                self.lost += self._begun and not self._whole
                self._nodes, self._begun, self._whole = [], True, follows
            self._nodes.append(node)
        return turns

    def forget(self) -> None:
        """Drop the turn that has begun: nodes are missing."""
        self.lost += self._begun
        self._nodes, self._begun, self._whole = [], False, True

    def _ends_at(self, node: Node) -> bool:
        if not self._nodes:
            return node.start and not self._front
        wrapped = self._turned(self._nodes[-1]) > FULL_TURN / 2 > self._turned(node)
        return wrapped and (len(self._nodes) >= FEWEST_NODES or not self._begun)

    def _turned(self, node: Node) -> float:
        """Return how far the lidar had turned since it looked to the front."""
        return (node.angle - self._front) % FULL_TURN


def ranges(turn: Sequence[Node], *, forward: float = 0.0) -> list[float]:
    """Return the nearest distance in m in each degree, counter-clockwise from straight ahead; 0: nothing there.

    `forward` is the lidar's angle that points ahead on the robot.
    """
    found = [0.0] * BINS
    for node in turn:
        if node.distance:
            at = round(forward - node.angle) % BINS
            metres = node.distance / 1000
            found[at] = min(found[at] or metres, metres)
    return found


def _fits(before: Node, node: Node) -> bool:
    step = (node.angle - before.angle + FULL_TURN / 2) % FULL_TURN - FULL_TURN / 2
    return LEAST_STEP <= step <= GREATEST_STEP
