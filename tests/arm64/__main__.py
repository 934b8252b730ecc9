"""The command line: python -m tests.arm64 builds the operator's image for arm64 and compares what it says."""

from __future__ import annotations

import logging
import re
import signal
import sys
import time

from tests.arm64 import emulation
from tests.node import images
from tests.node.errors import ClusterError
from tests.node.layout import REPOSITORY

log = logging.getLogger(__name__)

ARCHITECTURE = "arm64"
DOCKERFILE = REPOSITORY / "operator" / "Dockerfile"
SAMPLES = REPOSITORY / "config" / "expectations"
FOLDERS = (REPOSITORY / "config", REPOSITORY / "timelines")
COMMAND = re.compile(r"^# contextpolicy (simulate .+?) --assert", re.MULTILINE)
PROGRAM = "/opt/contextpolicy/bin/contextpolicy"
TIMEOUT = 600.0


def main() -> int:
    """Exit 0 when both architectures say the same, byte by byte."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # as after Ctrl-C, nothing is left behind
    try:
        with emulation.registered():
            images.built("contextpolicy", DOCKERFILE, REPOSITORY)
            foreign = images.foreign("contextpolicy", DOCKERFILE, REPOSITORY, ARCHITECTURE)
            different = [line for line in lines() if not same(line, images.reference("contextpolicy"), foreign)]
    except ClusterError as error:
        log.error("error: %s", error)  # noqa: TRY400, the message is the explanation
        return 1
    return 1 if different else 0


def lines() -> list[list[str]]:
    """Return the command lines to compare: every sample policy's plans, and the first words of operator and agent."""
    samples = [COMMAND.search(file.read_text()) for file in sorted(SAMPLES.glob("*.yaml"))]
    simulations = [[*found[1].split(), "--output", "json"] for found in samples if found]
    return [["--version"], ["run", "--help"], ["agent", "--help"], *simulations]


def same(line: list[str], native: str, foreign: str) -> bool:
    """Run a command line in both images and say what came of it."""
    ours, theirs = (_answer(image, line) for image in (native, foreign))
    verdict = "identical" if ours[0] == theirs[0] else "DIFFERENT"
    log.info("%-9s %7d bytes  %5.1f s and %5.1f s  %s", verdict, len(ours[0]), ours[1], theirs[1], " ".join(line))
    return ours[0] == theirs[0]


def _answer(image: str, line: list[str]) -> tuple[str, float]:
    began = time.monotonic()
    words = [str(images.INSIDE / word) if word.startswith(("config/", "timelines/")) else word for word in line]
    return images.run(image, [PROGRAM, *words], folders=FOLDERS, timeout=TIMEOUT), time.monotonic() - began


if __name__ == "__main__":
    sys.exit(main())
