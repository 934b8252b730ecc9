"""The operator as a whole, in virtual time."""

from tests.policies.conftest import operator, running

__all__ = ["operator", "running"]
