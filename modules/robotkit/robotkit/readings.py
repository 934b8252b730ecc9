"""What modules work with, whatever the wire format: a picture, an IMU sample, sound; from our own formats or ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from robotkit import json_text
from robotkit.errors import MessageError
from robotkit.profile import PLAUSIBLE_NS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from robotkit.inputs import Received

    Image = NDArray[np.uint8]

IMAGE, COMPRESSED_IMAGE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
IMU = "sensor_msgs/msg/Imu"

_CHANNELS = {"mono8": 1, "8UC1": 1, "bgr8": 3, "rgb8": 3, "8UC3": 3, "bgra8": 4, "rgba8": 4}


@dataclass(frozen=True, slots=True)
class ImuSample:
    """Angular rates in rad/s and accelerations in m/s2, in the sensor's frame; `stamp` in ns since 1970."""

    stamp: int
    gyro: tuple[float, float, float]
    accel: tuple[float, float, float]


def imu(received: Received) -> ImuSample:
    """An IMU sample from `{"gyro": [x, y, z], "accel": [x, y, z], "stamp": ns}` or sensor_msgs/Imu."""
    if received.encoding == "cdr":
        message, stamp = _ros(received, IMU)
        return ImuSample(stamp, _axes(message.angular_velocity), _axes(message.linear_acceleration))
    try:
        fields = json_text.loads(received.payload)
        stamp = fields.get("stamp", received.stamp)
        gyro, accel = (tuple(map(float, fields[name])) for name in ("gyro", "accel"))
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise MessageError(f"not an IMU sample: {error!r}") from error
    if not isinstance(stamp, int) or len(gyro) != 3 or len(accel) != 3 or not all(map(math.isfinite, gyro + accel)):
        raise MessageError(f"not an IMU sample: {str(fields)[:200]}")
    return ImuSample(stamp, gyro, accel)


def sound(received: Received) -> bytes:
    """16 kHz, 16 bit, mono samples, from a raw payload or from audio_common_msgs/AudioData(Stamped)."""
    samples = received.payload
    if received.encoding == "cdr":
        from robotkit.ros_types import AUDIO, AUDIO_STAMPED  # noqa: PLC0415 - an extra

        message = _decoded(received)
        audio = getattr(message, "audio", message)
        if received.type not in (AUDIO, AUDIO_STAMPED):
            raise MessageError(f"invalid type {received.type}: expected sound, {AUDIO} or {AUDIO_STAMPED}")
        samples = audio.data.tobytes()
    if len(samples) % 2:
        raise MessageError(f"{len(samples)} bytes are not 16 bit samples")
    return samples


def picture(received: Received, *, gray: bool = False) -> tuple[Image, int]:
    """A picture (BGR, or gray) and its stamp, from PNG, JPEG, sensor_msgs/Image or CompressedImage; needs OpenCV."""
    if received.encoding != "cdr":
        return decoded(received.payload, gray=gray), received.stamp
    message, stamp = _ros(received, IMAGE, COMPRESSED_IMAGE)
    if received.type == COMPRESSED_IMAGE:
        return decoded(message.data.tobytes(), gray=gray), stamp
    return _raw(message, gray=gray), stamp


def taken_at(stamp: int, received: Received) -> int:
    """When a picture was taken, by the stamp in it; a recording's is old: it counts as taken when it is played."""
    return stamp if abs(received.stamp - stamp) <= PLAUSIBLE_NS else received.stamp


def decoded(encoded: bytes, *, gray: bool) -> Image:
    """Decode PNG, JPEG or whatever else OpenCV reads; MessageError when it can't."""
    import cv2  # noqa: PLC0415 - only modules that process pictures install it
    import numpy as np  # noqa: PLC0415

    mode = cv2.IMREAD_GRAYSCALE if gray else cv2.IMREAD_COLOR_BGR
    try:
        image = cv2.imdecode(np.frombuffer(encoded, np.uint8), mode) if encoded else None
    except cv2.error as error:
        raise MessageError(f"a picture of {len(encoded)} bytes cannot be decoded: {error.err}") from error
    if image is None:
        raise MessageError(f"a picture of {len(encoded)} bytes cannot be decoded")
    return image.astype(np.uint8, copy=False)


def _raw(message: Any, *, gray: bool) -> Image:
    import numpy as np  # noqa: PLC0415 - comes with OpenCV and with rosbags

    channels = _CHANNELS.get(message.encoding)
    if channels is None:
        raise MessageError(f"invalid picture encoding {message.encoding}: expected one of {', '.join(_CHANNELS)}")
    width, height, step = message.width, message.height, message.step
    if step < width * channels or len(message.data) < step * height or not width or not height:
        raise MessageError(f"{len(message.data)} bytes are not a {width} x {height} {message.encoding} picture")
    rows = message.data[: step * height].reshape(height, step)[:, : width * channels]
    return _coloured(np.ascontiguousarray(rows.reshape(height, width, channels)), message.encoding, gray=gray)


def _coloured(pixels: Image, encoding: str, *, gray: bool) -> Image:
    import cv2  # noqa: PLC0415
    import numpy as np  # noqa: PLC0415

    if pixels.shape[2] == 1:
        return pixels[:, :, 0] if gray else cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR).astype(np.uint8, copy=False)
    order = "RGB" if encoding.startswith("rgb") else "BGR"
    source = f"{order}A" if pixels.shape[2] == 4 else order
    target = "GRAY" if gray else "BGR"
    if source == target:
        return pixels
    return cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{source}2{target}")).astype(np.uint8, copy=False)


def _ros(received: Received, *allowed: str) -> tuple[Any, int]:
    """The message and its stamp; the sample's stamp when the header has none."""
    from robotkit import ros  # noqa: PLC0415 - an extra

    if received.type not in allowed:
        raise MessageError(f"invalid type {received.type}: expected {' or '.join(allowed)}")
    message = _decoded(received)
    return message, ros.stamp_of(message) or received.stamp


def _decoded(received: Received) -> Any:
    from robotkit import ros  # noqa: PLC0415 - an extra

    return ros.decode(received.payload, received.type, release=received.ros, folder=received.types)


def _axes(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z
