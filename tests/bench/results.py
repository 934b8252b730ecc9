"""Where benchmarks leave their figures, and how parts of one are chosen."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from tests.node.layout import REPOSITORY

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

OUTPUT = REPOSITORY / "build" / "bench"


def keep(name: str, result: Mapping[str, Any]) -> None:
    """Write the figures to build/bench/<name>.json."""
    OUTPUT.mkdir(parents=True, exist_ok=True)
    (OUTPUT / f"{name}.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


def named(benchmark: str, chosen: tuple[str, ...], every: Collection[str]) -> str:
    """The name of the figures of some parts: the benchmark's where it is all of them."""
    return benchmark if chosen == tuple(every) else "-".join([benchmark, *chosen])


def some_of(every: Collection[str]) -> Callable[[str], tuple[str, ...]]:
    """How an option names parts: `a,b`, in whatever order."""

    def chosen(text: str) -> tuple[str, ...]:
        names = text.split(",")
        if set(names) - set(every):
            raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected one or more of {','.join(every)}")
        return tuple(name for name in every if name in names)

    return chosen
