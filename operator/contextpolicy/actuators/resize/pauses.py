"""How long to wait before something is tried again: doubled each time. Pure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Pause:
    """Seconds: the first pause and the longest."""

    first: float
    longest: float

    def after(self, times: int) -> float:
        """The pause after so many times in a row."""
        return min(self.longest, self.first * 2.0 ** min(times - 1, 20)) if times > 0 else 0.0


FAILED = Pause(0.1, 5.0)
"""After a patch without a usable answer: the API server is busy or gone for a moment."""
REFUSED = Pause(5.0, 120.0)
"""After a refusal. What refuses (a quota, a LimitRange, a role, an admission policy) may change with nothing on the pod
changing, and nobody tells us; so nothing is refused for ever, and nothing is asked for often."""
CONTESTED = Pause(0.5, 5.0)
"""Before a container that somebody else resizes as well is put back, from the second time on."""
OVERLOOKED = Pause(2.0, 120.0)
"""For which a kubelet may say nothing about a resize that it has seen; it looks at the runtime once a second."""
