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
        fewer than its own while most are being answered. Where there is none, it is the newcomer, unless it is its
        address's only one.
        """
        numbers = Counter(held.address for held in self._held.values())
        if numbers[address] < PER_ADDRESS and len(self._held) < AT_ONCE:
            closed = None
        else:
            refused = newcomer if numbers[address] or len(self._held) >= AT_ONCE + FOR_NEW_ADDRESSES else None
            evictable = self._evictable(address, numbers)
            closed = max(evictable, key=lambda own: numbers[self._held[own].address], default=refused)
        if closed is not newcomer:
            self._held[newcomer] = _Held(address)
        if closed is not None:
            self.leave(closed)
        return closed

    def _evictable(self, address: str, numbers: Counter[str]) -> list[Connection]:
        """Those that may be closed for a newcomer from this address."""
        waiting = {own: held.address for own, held in self._held.items() if not held.answered}
        if numbers[address] >= PER_ADDRESS:
            return [own for own, other in waiting.items() if other == address]
        # The one that has waited longest of so many is no probe, whose request comes at once.
        if len(waiting) > AT_ONCE // 2:
            return list(waiting)
        return [own for own, other in waiting.items() if numbers[other] >= numbers[address]]

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
