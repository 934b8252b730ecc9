"""Agents that tests have killed."""

from __future__ import annotations

import gc

import pytest


@pytest.fixture(scope="module", autouse=True)
def _let_go_of_files():
    """A killed agent closes nothing; thousands of open files would be too many for whoever uses select() later."""
    yield
    gc.collect()
