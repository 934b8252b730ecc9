"""`python -m modules.speech`: keywords from the microphone."""

from pathlib import Path

from modules.robotkit.task import load_task, main
from modules.speech.spotter import Spotter
from modules.speech.task import Speech

main(load_task(Path(__file__).with_name("module.yaml")), Speech(Spotter()).process)
