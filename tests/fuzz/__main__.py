"""`python -m tests.fuzz TARGET -max_total_time=60`: fuzzing that follows the code's branches, by hand.

TARGET is what comes from outside; the options are libFuzzer's, such as -fork=1 and a folder for the corpus. Needs
`pip install atheris`. What crashes becomes an example of `test_fuzz`.
"""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import atheris  # type: ignore[import-untyped,import-not-found,unused-ignore]

with atheris.instrument_imports(include=["contextpolicy"]):
    from tests.fuzz import targets

from tests.agent.builders import a_message, a_target
from tests.bus import messages
from tests.cluster.builders import a_pod, cpu
from tests.fuzz.documents import APPLIED, REPORT

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    Target = Callable[[bytes], None]


def either(target: Target, good: object) -> Target:
    """Any bytes, or, after an odd one, a good document with damaged fields."""
    return lambda data: target(
        json.dumps(targets.damaged(good, data[1:])).encode() if data and data[0] % 2 else data[1:]
    )


TARGETS: Mapping[str, Target] = {
    "payload": targets.payload,
    "policy": targets.policy,
    "expression": targets.expression,
    "recording": targets.recording,
    "report": either(targets.report, REPORT),
    "order": either(targets.order, json.loads(a_message(a_target()))),
    "plan": either(lambda data: targets.shown([(messages.KEY, data)]), messages.plan()),
    "applied": either(lambda data: targets.shown([(messages.APPLIED, data)]), APPLIED),
    "board": either(targets.board, messages.BOARD),
    "watch": either(targets.event, {"type": "MODIFIED", "object": a_pod(sidecars={"proxy": cpu("1m", "2m")})}),
    "answer": either(lambda data: targets.answer(200, data), a_pod()),
    "refusal": either(lambda data: targets.answer(422, data), {"message": "no", "details": {"causes": [{}]}}),
}

if __name__ == "__main__":
    chosen = TARGETS.get(sys.argv[1] if len(sys.argv) > 1 else "")
    if chosen is None:
        sys.exit(f"{__doc__}\nTARGET: one of {', '.join(TARGETS)}")
    atheris.Setup([sys.argv[0], *sys.argv[2:]], chosen)
    atheris.Fuzz()
