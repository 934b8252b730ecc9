"""What can go wrong with the node, in the words that the person at the terminal sees."""

from __future__ import annotations


class ClusterError(Exception):
    """The message names the step or component, what was expected and where to look."""
