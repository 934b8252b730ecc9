"""Which recordings there are, and making those that are missing or outdated."""

from __future__ import annotations

import hashlib
import math
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from modules.speech import synthesis
from timelines.datasets import corridor, euroc, motion, side_view, speech
from timelines.datasets.euroc import RIG, Sequence
from timelines.datasets.motion import Motion
from timelines.datasets.side_view import SideView
from timelines.datasets.speech import Script, Utterance

if TYPE_CHECKING:
    from collections.abc import Mapping

    from timelines.scenarios.scenario import Scenario

Recording: TypeAlias = Sequence | Script | SideView
Progress: TypeAlias = Callable[[float], None]

ROOT = Path("build/datasets")
QUARTER = (0.8 * math.pi / 2, math.pi / 2)
"""A left turn with a radius of 0.8 m."""
LAP = ((2, 0), QUARTER, (3, 0), QUARTER, (4, 0), QUARTER, (3, 0), QUARTER, (2, 0))
"""Once around the block, 19 m."""
LOOPS = Sequence(
    Motion(duration=74, moving=((1, 18), (20, 45), (48, 73)), speed=0.58, course=LAP * 2),
    camera_rate=5,
    hall=corridor.Hall((-3.9, -1.2), (3.9, 5.8), (((-1.7, 1.2), (1.7, 3.4)),)),
)
"""Two laps around a block, with stops: where SLAM must find out that it has been here before."""
RECORDINGS: Mapping[str, Recording] = {
    "euroc": Sequence(Motion(duration=30, moving=((10, 20),))),
    "loops": LOOPS,
    "speech/demo": Script(
        duration=30,
        utterances=(
            Utterance(5.3, "forward", "rms"),
            Utterance(6.6, "left", "slt"),
            Utterance(7.9, "stop", "cmu_us_slt_arctic_hts"),
            Utterance(14.0, "right", "kal_diphone"),
            Utterance(23.3, "backward", "slt"),
            Utterance(24.7, "right", "cmu_us_slt_arctic_hts"),
            Utterance(25.9, "stop", "kal16"),
        ),
    ),
    "speech/commands": speech.every_command(),
}

_GENERATORS = {Sequence: (euroc, corridor, motion), Script: (speech, synthesis), SideView: (side_view,)}


def of_scenario(scenario: Scenario) -> dict[str, Recording]:
    """What a scenario's timeline names."""
    return {
        scenario.name: Sequence(scenario.motion, scenario.camera_rate),
        f"speech/{scenario.name}": scenario.script,
        f"signs/{scenario.name}": scenario.side_view,
    }


def make(root: Path, name: str, recording: Recording, progress: Progress) -> bool:
    """Make one recording unless it is up to date; returns whether it was made."""
    folder = root / name
    stamp = fingerprint(recording)
    if is_current(folder, stamp):
        return False
    folder.parent.mkdir(parents=True, exist_ok=True)
    # Made aside and renamed, so that an interrupted run never leaves half a recording.
    with tempfile.TemporaryDirectory(dir=root, prefix=".making-") as scratch:
        made = Path(scratch, "recording")
        made.mkdir()
        _write(made, recording, progress)
        (made / "stamp").write_text(stamp, encoding="utf-8")
        shutil.rmtree(folder, ignore_errors=True)
        made.rename(folder)
    return True


def is_current(folder: Path, stamp: str) -> bool:
    """Whether the folder was made from the same description by the same code."""
    file = folder / "stamp"
    return file.is_file() and file.read_text(encoding="utf-8") == stamp


def fingerprint(recording: Recording) -> str:
    """A hash of a recording's description, the code that makes it and the cameras' calibration."""
    digest = hashlib.sha256(repr(recording).encode())
    generators = [Path(module.__file__ or "") for module in _GENERATORS[type(recording)]]
    for path in [*generators, *sorted(RIG.glob("*/sensor.yaml"))]:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _write(folder: Path, recording: Recording, progress: Progress) -> None:
    match recording:
        case Sequence():
            euroc.write(folder, recording, progress)
        case Script():
            speech.write(folder, recording, progress)
        case SideView():
            side_view.write(folder, recording, progress)
