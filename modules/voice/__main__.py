"""`python -m modules.voice`: the robot speaks."""

import os
import shlex
from pathlib import Path

from modules.voice.flite import VOICES, Flite, Player
from modules.voice.task import Voice
from robotkit import main

main(
    Path(__file__).with_name("module.yaml"),
    lambda: Voice(Flite(os.environ.get("VOICE") or VOICES[0]), Player(shlex.split(os.environ.get("VOICE_PLAYER", "")))),
)
