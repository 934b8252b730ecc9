"""Our share of the CPU, and what somebody else writes instead."""

from __future__ import annotations

from contextpolicy.cluster.pods import Cpu

OURS, THEIRS, OTHERS = Cpu(10, 300), Cpu(10, 700), Cpu(10, 710)
