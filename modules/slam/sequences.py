"""A recorded stereo sequence with its own calibration, in EuRoC's layout or KITTI's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from modules.slam import kitti
from modules.slam.calibration import Rig, load_rig
from robotkit import euroc

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from robotkit.stereo import StereoFrame


@dataclass(frozen=True)
class Recording:
    """Two cameras, and their pictures in the order of time."""

    rig: Rig
    frames: Iterable[StereoFrame]


def recording(folder: Path) -> Recording:
    """Open a sequence's folder; DatasetError where it has neither layout."""
    if kitti.is_sequence(folder):
        return Recording(kitti.rig(folder), kitti.stereo(folder))
    mav0 = euroc.find(folder)
    return Recording(load_rig(mav0), euroc.stereo(mav0))


def truth(folder: Path) -> list[euroc.TruePose]:
    """The body's true poses; DatasetError where the sequence has none."""
    known = kitti.truth(folder) if kitti.is_sequence(folder) else euroc.truth(euroc.find(folder))
    if not known:
        raise euroc.DatasetError(f"{folder}: there is no ground truth: expected {euroc.TRUTH}/data.csv, or poses.txt")
    return known
