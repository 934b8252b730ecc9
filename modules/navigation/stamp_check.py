"""How old a sample is: counted from when its source published it, by the stamp on it.

Only that stamp shows that a sample waited: while this process is frozen or throttled, samples wait in the socket, and
they arrive only when it runs again. The source may run on another computer, whose clock is off. Behind, it makes
samples look older than they are, which is safe. Ahead, it makes old ones look new; but a sample that arrives before it
was published proves that, and then none of its input is believed for a while. Either way the message says so.
"""

from __future__ import annotations

import math

from robotkit import MessageError

AHEAD_S = 0.1
"""How far a source's clock may be ahead; computers that are synchronised over a network are closer."""
DISTRUST_S = 60.0
"""How long a clock that was further ahead is not believed."""


class StampCheck:
    """Of one input. Pure: times are arguments, in ns since 1970."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._ahead, self._caught = 0.0, -math.inf

    def hear(self, stamp: int, received: int) -> None:
        """Compare a sample's stamp with its arrival."""
        ahead = (stamp - received) / 1e9
        if ahead > AHEAD_S:
            self._ahead, self._caught = ahead, received

    def age(self, stamp: int, now: int, most: float) -> float:
        """Return a sample's age in s; MessageError when it is more than `most`, or the clock can't be believed."""
        if now - self._caught < DISTRUST_S * 1e9:
            raise MessageError(
                f"{self._name}: its source's clock is {self._ahead:.1f} s ahead of this computer's, more than "
                f"{AHEAD_S:g} s: synchronise the clocks"
            )
        age = (now - stamp) / 1e9
        if age > most:
            raise MessageError(
                f"{self._name}: published {age:.1f} s ago, more than {most:g} s: "
                "it was delayed, or its source's clock is behind this computer's"
            )
        return max(age, 0.0)
