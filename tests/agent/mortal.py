"""An agent as a process, without a bus: `python -m tests.agent.mortal CGROUP_ROOT STATE PLANS`.

It prints `here`, carries out so many plans, or plans without end (-1), prints the number of each, and undoes them at
SIGTERM.
"""

from __future__ import annotations

import itertools
import signal
import sys
from pathlib import Path

from reactivex.testing import TestScheduler

from contextpolicy.agent.state_directory import StateDirectory
from tests.agent.builders import POLICY, SLAM, SPEECH, UNWATCHED, Informed, a_message, a_target, agent_settings
from tests.waiting import PATIENCE


def main(root: Path, state: Path, plans: int) -> int:
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    say("here")
    if not StateDirectory(state).begin_life(PATIENCE):
        return 1
    agent = Informed(agent_settings(root, state), TestScheduler(), lambda _: UNWATCHED)
    agent.start()
    agent.find_source(POLICY)
    for number in itertools.count(1) if plans < 0 else range(1, plans + 1):
        share = number % 8 / 10 + 0.1
        targets = a_target(SLAM, share), a_target(SPEECH, 0.9 - share, task="speech")
        agent.hear(POLICY, a_message(*targets, sequence=number))
        say(number)
    signal.sigwait({signal.SIGTERM})
    agent.stop()
    return 0


def say(word: object) -> None:
    sys.stdout.write(f"{word}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])))
