"""What a soak showed, as the section of docs/measurements/faults.md about it. Pure."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tests.soak import growth

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from datetime import date

    from tests.soak.growth import Series

HEADING = "## An hour of everything"
GOOD = "No limit was ever wrong, the newest plan was in force afterwards, and every container was left as it came."


@dataclass(frozen=True)
class Soak:
    """How a soak went: `failed` says which checks did, `had` which troubles there were.

    `lives` has the last process of each part.
    """

    seed: int
    seconds: float
    day: date
    cores: int
    killed: Iterable[str] = ()
    had: Iterable[str] = ()
    failed: Iterable[str] = ()
    lives: Mapping[str, Series] = field(default_factory=dict)


def section(soak: Soak) -> str:
    """The section, with its heading."""
    failed = ", ".join(soak.failed)
    verdict = f"**Failed: {failed}.**" if failed else GOOD
    return f"""{HEADING}

`make soak SEED={soak.seed}` for {soak.seconds:.0f} s on {soak.day:%Y-%m-%d}, {soak.cores} cores:
contexts at 2 Hz, pods that come and go, kills ({_counted(soak.killed)}),
and troubles that others make ({_counted(soak.had)}). {verdict}

| last life | threads | sockets | memory |
|---|---|---|---|
{"".join(_row(part, life) for part, life in soak.lives.items())}
"""


def replaced(page: str, text: str) -> str:
    """The page with this section in the place of the last soak's."""
    return re.sub(rf"^{HEADING}\n.*?(?=^## )", lambda _: text, page, flags=re.MULTILINE | re.DOTALL)


def _counted(what: Iterable[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in sorted(Counter(what).items())) or "none"


def _row(part: str, life: Series) -> str:
    if len(life) < 2:
        return f"| {part} | too short a life to say | | |\n"
    ends = life[0], life[-1]
    threads, sockets = (" to ".join(str(getattr(end, name)) for end in ends) for name in ("threads", "sockets"))
    memory = " to ".join(f"{end.memory / growth.MIB:.0f}" for end in ends)
    return f"| {part}, {(ends[1].at - ends[0].at) / 60:.0f} minutes | {threads} | {sockets} | {memory} MiB |\n"
