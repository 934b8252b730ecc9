"""`python -m tests.oracle --policies N --seed S`: random policies, decided by the planner and by the reference model.

Prints the least story of each kind of difference, and ends with 1 if there is any.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import sys
from pprint import pformat

from tests.oracle.comparison import difference, least
from tests.oracle.generator import a_story


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policies", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0, help="of the first one; each other has the next number")
    parser.add_argument("--show", type=int, default=3, help="how many differences to show in full")
    options = parser.parse_args()
    found = 0
    for seed in range(options.seed, options.seed + options.policies):
        reported = difference(a_story(seed))
        if reported is None:
            continue
        found += 1
        print(f"seed {seed}: {reported}")
        if found <= options.show:
            story = least(a_story(seed))
            print(f"at the least: {difference(story)}\n{pformat(story, width=120, compact=True)}\n")
    print(f"{found} of {options.policies} policies differ")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
