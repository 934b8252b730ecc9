"""`python -m timelines.recording RUN.mcap --labels LABELS.yaml`: turn a robot's recording into a labelled timeline."""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

from contextpolicy.errors import ContextPolicyError
from contextpolicy.streams.recordings import Excerpt, is_recording, open_recording
from timelines.datasets.readers import MESSAGES
from timelines.datasets.recordings import ROOT
from timelines.recording.labels import labelled, load_labels
from timelines.scenarios.__main__ import as_text


def main(arguments: list[str] | None = None) -> int:
    """Write the timeline, and keep the recording as the data set that it names; exit code 2 if one is refused."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if not is_recording(options.recording) or options.recording.suffix != ".mcap":
        parser.error(
            f"invalid value {str(options.recording)!r}: expected an MCAP file; `ros2 bag convert` makes one of a bag"
        )
    try:
        labels = load_labels(options.labels)
        document = labelled(open_recording(options.recording, Excerpt()), labels)
        path = options.out / f"{labels.name}.json"
        path.write_text(as_text(document), encoding="utf-8")
        kept = options.datasets / labels.name / MESSAGES
        if any("dataset" in entry for entry in document["inputs"]):
            kept.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(options.recording, kept)
            sys.stdout.write(f"{kept}: the data set of {path.name}\n")
    except (ContextPolicyError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(f"{path}: {len(document['inputs'])} inputs, {document['duration']:g} s\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m timelines.recording", description=__doc__)
    parser.add_argument("recording", type=Path, help="an MCAP file")
    parser.add_argument(
        "--labels", type=Path, required=True, metavar="FILE", help="YAML, see timelines/recording/labels.py"
    )
    parser.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="folder of the timeline (this one)")
    parser.add_argument("--datasets", type=Path, default=ROOT, metavar="DIR", help="folder of data sets (%(default)s)")
    return parser


if __name__ == "__main__":
    sys.exit(main())
