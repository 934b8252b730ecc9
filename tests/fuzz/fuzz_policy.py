"""`python -m tests.fuzz.fuzz_policy -max_total_time=60` (libFuzzer's options; needs `pip install atheris`)."""

from __future__ import annotations

import sys

import atheris  # type: ignore[import-untyped,import-not-found,unused-ignore]

with atheris.instrument_imports(include=["contextpolicy"]):
    from tests.fuzz import targets

if __name__ == "__main__":
    atheris.Setup(sys.argv, targets.policy)
    atheris.Fuzz()
