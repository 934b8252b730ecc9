"""What a robot's mission says on the bus: what it is about, and how fast it should drive meanwhile. Pure."""

from __future__ import annotations

KEY = "robot/mission"
"""`{"does": "drive", "forward": 0.3}`, as a behaviour tree would publish it."""
RATE = 5
"""Hz: it is repeated, so that who comes later hears it too."""
KINDS = ("drive", "talk", "read", "grip")
"""What a mission can be about: where the robot is, what it hears, what it reads, what it holds."""
