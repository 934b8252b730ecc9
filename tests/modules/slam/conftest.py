from __future__ import annotations

import pytest

from timelines.datasets import euroc
from timelines.datasets.motion import Motion


@pytest.fixture(scope="session")
def short(tmp_path_factory):
    """5 s of a corridor at 10 Hz; for the first and the last half second the robot stands."""
    root = tmp_path_factory.mktemp("datasets")
    euroc.write(root / "short", euroc.Sequence(Motion(duration=5, moving=((0.5, 4.5),))), progress=lambda _: None)
    return root / "short"
