"""`python -m modules.signs`: numbers of rooms and houses from the side camera."""

import os
from pathlib import Path

import cv2

from modules.signs.detector import Detector, Region
from modules.signs.digits import Digits
from modules.signs.networks import find
from modules.signs.paddle import Paddle
from modules.signs.task import Signs
from modules.signs.watcher import Watcher
from robotkit import ConfigurationError, main

READERS = ("paddle", "digits")


def build() -> Signs:
    """Make the task as the environment wants it."""
    cv2.setNumThreads(1)  # its share is what the policy gives, not all cores
    networks = find(os.environ.get("SIGNS_MODELS", ""))
    wanted = os.environ.get("SIGNS_READER", READERS[0])
    if wanted not in READERS:
        raise ConfigurationError(f"SIGNS_READER: invalid value {wanted!r}: expected {' or '.join(READERS)}")
    reader = Paddle(*networks.recognition()) if wanted == "paddle" else Digits()
    return Signs(Watcher(Detector(networks.detection(), _region()), reader))


def _region() -> Region:
    text = os.environ.get("SIGNS_REGION", "0 0 1 1")
    try:
        return Region.parse(text)
    except ValueError as error:
        raise ConfigurationError(f"SIGNS_REGION: invalid value {text!r}: {error}") from error


main(Path(__file__).with_name("module.yaml"), build)
