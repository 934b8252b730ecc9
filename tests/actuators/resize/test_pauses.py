from __future__ import annotations

import pytest

from contextpolicy.actuators.resize.pauses import Pause


@pytest.mark.parametrize(("times", "seconds"), [(0, 0), (1, 0.5), (2, 1), (3, 2), (4, 3), (10**6, 3)])
def test_a_pause_doubles_up_to_the_longest(times, seconds):
    assert Pause(0.5, 3).after(times) == seconds
