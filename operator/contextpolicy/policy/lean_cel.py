"""The CEL library without its command line, which nothing here uses and which the library imports.

Its terminal toolkit is a fifth of the CPU that the operator's start takes, and 11 MiB of the operator and of the agent.
"""

from __future__ import annotations

import sys
from types import ModuleType

sys.modules.setdefault("cel.cli", ModuleType("cel.cli"))

import cel  # noqa: E402 - only now

__all__ = ["cel"]
