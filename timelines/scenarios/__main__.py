"""`python -m timelines.scenarios [FILE.yaml ...]`: make timelines of scenarios, and their recordings with --record."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from modules.speech.synthesis import SpeechError
from timelines.datasets.__main__ import make_all
from timelines.datasets.recordings import ROOT, of_scenario
from timelines.scenarios.inputs import timeline
from timelines.scenarios.scenario import FOLDER, ScenarioError, load

if TYPE_CHECKING:
    from collections.abc import Mapping


def main(arguments: list[str] | None = None) -> int:
    """Write one timeline for each scenario; exit code 2 if one is refused."""
    options = _parser().parse_args(arguments)
    try:
        scenarios = [load(path) for path in options.scenarios or sorted(FOLDER.glob("*.yaml"))]
        for scenario in scenarios:
            path = options.out / f"{scenario.name}.json"
            path.write_text(as_text(timeline(scenario)), encoding="utf-8")
            sys.stdout.write(f"{path}: {scenario.duration:g} s\n")
            if options.record:
                make_all(options.datasets, of_scenario(scenario))
    except (ScenarioError, SpeechError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def as_text(document: Mapping[str, Any]) -> str:
    """JSON with a line for each phase and input, so that people can read and compare it."""
    parts = []
    for name, value in document.items():
        if name in ("phases", "inputs"):
            lines = ",\n".join(f"    {json.dumps(item, ensure_ascii=False)}" for item in value)
            parts.append(f'  "{name}": [\n{lines}\n  ]')
        else:
            parts.append(f"  {json.dumps(name)}: {json.dumps(value, ensure_ascii=False)}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m timelines.scenarios", description=__doc__)
    parser.add_argument("scenarios", nargs="*", type=Path, metavar="FILE", help="scenarios (the shipped ones)")
    parser.add_argument(
        "--out", type=Path, default=FOLDER.parent, metavar="DIR", help="folder of the timelines (timelines)"
    )
    parser.add_argument("--record", action="store_true", help="make the recordings too, unless they are up to date")
    parser.add_argument("--datasets", type=Path, default=ROOT, metavar="DIR", help="folder of recordings (%(default)s)")
    return parser


if __name__ == "__main__":
    sys.exit(main())
