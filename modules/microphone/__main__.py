"""`python -m modules.microphone`: sound from MICROPHONE_SOURCE."""

import os
from pathlib import Path

from modules.microphone.sources import Device, Recorded
from modules.microphone.task import Microphone
from robotkit import ConfigurationError, main


def build() -> Microphone:
    """Make the task that the environment describes."""
    kind, _, name = os.environ.get("MICROPHONE_SOURCE", "").partition(":")
    if kind == "device":
        return Microphone(Device(name))
    if not kind:
        raise ConfigurationError("MICROPHONE_SOURCE is empty: a WAV file or its folder, or device, or device:NAME")
    return Microphone(Recorded(Path(os.environ["MICROPHONE_SOURCE"])))


main(Path(__file__).with_name("module.yaml"), build)
