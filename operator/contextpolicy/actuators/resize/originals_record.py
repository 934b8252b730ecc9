"""One policy's part of the originals: what its status should hold, what it holds, and what is being written. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.resize.merge_patch import either, merge_patch
from contextpolicy.actuators.resize.stored_originals import certain

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.cluster.pods import Cpu


@dataclass(slots=True)
class OriginalsRecord:
    """`wanted` and `handed_over` are containers by pod UID and name; other policies took the latter over.

    `held` is what the status holds, `UNSURE` where a failed write left that open, in the object of this `version`, and
    `certain` the originals in it. `shown` is what the watch showed while a write was under way. `unproven`
    are entries that stay as they were found.
    """

    wanted: set[tuple[str, str]] = field(default_factory=set)
    handed_over: set[tuple[str, str]] = field(default_factory=set)
    held: Mapping[str, Any] = field(default_factory=dict)
    version: int = 0
    certain: Mapping[tuple[str, str], Cpu] = field(default_factory=dict)
    sent: dict[str, Any] | None = None
    shown: tuple[Mapping[str, Any], int] | None = None
    unproven: Mapping[str, Any] = field(default_factory=dict)
    unsure: bool = False
    dirty: bool = False

    def hold(self, held: Mapping[str, Any], version: int) -> None:
        """The status holds this."""
        self.held, self.version, self.certain = held, version, certain(held)

    def mentions(self, uid: str, name: str) -> bool:
        """Whether the status says anything about a container."""
        entry = self.held.get(uid)
        containers = entry.get("containers") if isinstance(entry, dict) else None
        return isinstance(containers, dict) and name in containers

    def changes(self, wanted: Mapping[str, Any]) -> dict[str, Any]:
        """The merge patch that the status needs."""
        return merge_patch(wanted, self.held)

    def inspect(self, raw: Mapping[str, Any], version: int) -> bool:
        """Compare with what an object of this version holds; whether another client has changed it.

        An older one than we know of says nothing, and none does while a write is under way, or after one that failed
        and may still take effect.
        """
        if version < self.version:
            return False
        if self.sent is not None:
            self.shown = raw, version
            return False
        changed = raw != self.held
        if self.unsure:
            self.hold(either(self.held, raw), version)
        elif changed:
            self.hold(raw, version)
        self.dirty |= changed
        return changed and not self.unsure

    def succeed(self, version: int) -> bool:
        """What was sent is stored in this version; whether another client has changed it since."""
        self.hold(self.sent or {}, version)
        self.sent, self.unsure = None, False
        shown, self.shown = self.shown, None
        return shown is not None and shown[1] > version and self.inspect(*shown)

    def fail(self) -> None:
        """The status may hold what was sent, what it held before, or what the watch showed meanwhile."""
        if self.sent is None:
            return
        held = either(self.held, self.sent)
        if self.shown is not None:
            held = either(held, self.shown[0])
        self.hold(held, self.version)
        self.sent, self.shown, self.unsure, self.dirty = None, None, True, True
