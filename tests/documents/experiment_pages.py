"""The pages that say something of the experiments, and the data that they are of."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
REPORT, DETAILS, README, PAGE, PREDICTION, REACTION = (
    (ROOT / name).read_text(encoding="utf-8")
    for name in (
        "timelines/results/report.md",
        "timelines/results/details.md",
        "README.md",
        "docs/measurements/paper-experiments.md",
        "docs/measurements/prediction.md",
        "docs/measurements/reaction.md",
    )
)
DATA = ROOT / "timelines/results/data"
PREPARATION = DATA / "preparation"
