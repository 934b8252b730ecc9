"""`python -m modules.speech`: keywords from the microphone."""

from pathlib import Path

from modules.speech.listener import Listener
from modules.speech.task import Speech
from robotkit import main

main(Path(__file__).with_name("module.yaml"), lambda: Speech(Listener()))
