"""`python -m tests.bench.stopping`: how long a module needs to end after SIGTERM when its CPU limit is small.

Needs root: it makes a cgroup, version 1 or 2, and puts the module there: without input, as a suspended task is, and
busy with pictures at 10 Hz, which need more CPU than there is.
"""

from __future__ import annotations

import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

from tests.bench.cgroup import cgroup
from tests.bench.child import program
from tests.modules.robotkit.bus import Matching, client, router
from timelines.datasets import euroc
from timelines.datasets.motion import Motion
from timelines.datasets.readers import read

if TYPE_CHECKING:
    import zenoh

ROUNDS = 10
LIMITS_M = (10, 20, 50)
SETTLED_S = 2


def main() -> None:
    """Print the seconds of every round."""
    with tempfile.TemporaryDirectory() as folder:
        euroc.write(Path(folder, "short"), euroc.Sequence(Motion(1, ((0, 1),))), progress=lambda _: None)
        frames = [payload for _, payload in read(Path(folder), "short/stereo") if isinstance(payload, bytes)]
    for limit in LIMITS_M:
        for name, shown in (("suspended", []), ("busy", frames)):
            seconds = sorted(_stop(shown, limit) for _ in range(ROUNDS))
            sys.stdout.write(f"{limit}m {name:9} {' '.join(f'{one:.3f}' for one in seconds)}\n")


def _stop(frames: list[bytes], limit: int) -> float:
    """Seconds from SIGTERM to the process's end."""
    with (
        router() as address,
        client(address) as session,
        cgroup("stopping") as group,
        program("-m", "modules.slam", group=group, ZENOH_CONNECT=address) as module,
    ):
        camera = session.declare_publisher("robot/camera/stereo")
        Matching(camera).wait(expected=True)
        ended = threading.Event()
        thread = threading.Thread(target=_show, args=(camera, frames, ended))
        thread.start()
        group.limit(limit / 1000)
        ended.wait(SETTLED_S)
        started = time.monotonic()
        module.terminate()
        module.wait()
        needed = time.monotonic() - started
        ended.set()
        thread.join()
        return needed


def _show(camera: zenoh.Publisher, frames: list[bytes], ended: threading.Event) -> None:
    while frames and not ended.is_set():
        for frame in frames:
            camera.put(frame)
            ended.wait(0.1)


if __name__ == "__main__":
    main()
