"""Property tests: the machine may be busy, so no example, and no making of one, has a deadline.

The same code is tried on the same examples: what fails was broken by the change that it fails on. Others, at random,
are tried with `pytest --hypothesis-profile default`.
"""

from __future__ import annotations

from hypothesis import HealthCheck, settings

settings.register_profile("steady", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("steady")
