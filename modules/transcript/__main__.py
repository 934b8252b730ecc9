"""`python -m modules.transcript`: text from the microphone."""

import os
from pathlib import Path

from modules.transcript.engines import engine
from modules.transcript.task import Transcript
from robotkit import main

main(Path(__file__).with_name("module.yaml"), lambda: Transcript(engine(os.environ)))
