"""Which connections an HTTP server keeps when more come than it serves at once."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Generic, TypeVar

AT_ONCE = 16
"""Connections that a server keeps."""
PER_ADDRESS = AT_ONCE // 2
"""How many of them one address may have: a kubelet's probe comes from another one than a flood."""
FOR_NEW_ADDRESSES = AT_ONCE
"""Connections beyond AT_ONCE while all of these are being answered, for addresses that have no other."""

Connection = TypeVar("Connection")


@dataclass
class _Held:
    address: str
    answered: bool = False
    """Whether the whole request is here, so that the rest is up to us."""


class Places(Generic[Connection]):
    """The connections that are kept, those that have waited longest for their request first; not thread-safe."""

    def __init__(self) -> None:
        self._held: dict[Connection, _Held] = {}

    def enter(self, newcomer: Connection, address: str) -> Connection | None:
        """Give a place to a connection; returns the one that has to be closed for it.

        That is the one that has kept us waiting longest, of the address that has the most, but not of one that has
        fewer than its own. Where there is none, it is the newcomer, unless it is its address's only one.
        """
        numbers = Counter(held.address for held in self._held.values())
        if numbers[address] < PER_ADDRESS and len(self._held) < AT_ONCE:
            closed = None
        else:
            others = {one for one, number in numbers.items() if number >= numbers[address]}
            eligible = {address} if numbers[address] >= PER_ADDRESS else others
            waiting = [own for own, held in self._held.items() if not held.answered and held.address in eligible]
            refused = newcomer if numbers[address] or len(self._held) >= AT_ONCE + FOR_NEW_ADDRESSES else None
            closed = max(waiting, key=lambda own: numbers[self._held[own].address], default=refused)
        if closed is not newcomer:
            self._held[newcomer] = _Held(address)
        if closed is not None:
            self.leave(closed)
        return closed

    def answer(self, connection: Connection) -> bool:
        """Note that its request is complete; False if it was closed to make room."""
        if connection not in self._held:
            return False
        self._held[connection].answered = True
        return True

    def wait(self, connection: Connection) -> None:
        """Note that it is answered, and may have another request."""
        if connection in self._held:
            self._held[connection] = _Held(self._held.pop(connection).address)

    def leave(self, connection: Connection) -> None:
        """Forget one that is closed."""
        self._held.pop(connection, None)
