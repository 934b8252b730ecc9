"""What all tests share: the examples of property tests, and what is left out where only `.[dev]` is installed.

Property tests: the machine may be busy, so no example, and no making of one, has a deadline. The same code is tried on
the same examples: what fails was broken by the change that it fails on. Others, at random, are tried with
`pytest --hypothesis-profile default`.
"""

from __future__ import annotations

from importlib.util import find_spec

from hypothesis import HealthCheck, settings

settings.register_profile("steady", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("steady")

collect_ignore = [] if find_spec("cv2") else ["modules", "timelines"]


def pytest_terminal_summary(terminalreporter):
    if collect_ignore:
        terminalreporter.write_line("tests/modules and tests/timelines need what `make setup` installs", yellow=True)
