"""Where sound comes from: a WAV file, or a device by PortAudio. Always 16 kHz, 16 bit, mono, in chunks of 0.1 s."""

from __future__ import annotations

import queue
import time
import wave
from typing import TYPE_CHECKING, Any, Protocol

from robotkit import DeviceError
from robotkit.euroc import DatasetError
from robotkit.playback import Playback

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator
    from pathlib import Path

RATE = 16_000
CHUNK = RATE // 10
CHUNK_NS = 100_000_000
BYTES_PER_SAMPLE = 2
SILENT_S = 1.0
"""A device that gives nothing for this many seconds is lost."""
WAITING = 50
"""Chunks that the driver may be ahead of us: 5 s."""


class Source(Protocol):
    """Gives chunks with the moment of their last sample (ns since 1970) until the end."""

    def chunks(self, ended: threading.Event) -> Iterator[tuple[int, bytes]]:
        """Open the source, yield (stamp, chunk), and release the source when closed."""


class Recorded:
    """A WAV file at its own pace; the last piece is left out when it is not a whole chunk."""

    def __init__(self, path: Path) -> None:
        self._path = path / "audio.wav" if path.is_dir() else path
        self._playback = Playback()
        for _ in self._read():  # reject an invalid file before the module counts as alive
            break

    def chunks(self, ended: threading.Event) -> Iterator[tuple[int, bytes]]:
        """Continue from where the recording would be by now."""
        return self._playback.play(self._read(), ended)

    def _read(self) -> Iterator[tuple[int, bytes]]:
        try:
            with wave.open(str(self._path)) as audio:
                form = (audio.getframerate(), audio.getsampwidth() * 8, audio.getnchannels())
                if form != (RATE, 16, 1):
                    found = f"{form[0]} Hz, {form[1]} bit, {form[2]} channels"
                    raise DatasetError(
                        f"{self._path}: unsupported format {found}: expected {RATE} Hz, 16 bit, 1 channel"
                    )
                number = 0
                while len(chunk := audio.readframes(CHUNK)) == CHUNK * BYTES_PER_SAMPLE:
                    number += 1
                    yield number * CHUNK_NS, chunk
        except (OSError, EOFError, wave.Error) as error:
            raise DatasetError(f"{self._path}: cannot be read: {error}") from error


class Device:
    """A microphone by PortAudio; its name may be a part of what the system calls it, empty for the default one."""

    def __init__(self, name: str, portaudio: Any = None) -> None:
        self._name = name
        self._portaudio = portaudio
        self._chunks: queue.Queue[tuple[int, bytes]] = queue.Queue(WAITING)

    def chunks(self, ended: threading.Event) -> Iterator[tuple[int, bytes]]:
        """Listen until the end; DeviceError when the device can't be opened or falls silent."""
        portaudio = self._portaudio or _portaudio()
        try:
            stream = portaudio.RawInputStream(
                samplerate=RATE,
                blocksize=CHUNK,
                device=self._name or None,
                channels=1,
                dtype="int16",
                callback=self._hear,
            )
        except (portaudio.PortAudioError, ValueError) as error:
            raise DeviceError(f"microphone {self._name or '(default)'} can't be opened: {error}") from error
        with stream:
            while not ended.is_set():
                try:
                    yield self._chunks.get(timeout=SILENT_S)
                except queue.Empty:
                    raise DeviceError(f"microphone {self._name or '(default)'} delivers no sound") from None

    def _hear(self, data: Any, _frames: int, _time: Any, _status: Any) -> None:
        """Called on the driver's thread, which must not block: a full queue drops its oldest chunk."""
        if self._chunks.full():
            self._chunks.get_nowait()
        self._chunks.put_nowait((time.time_ns(), bytes(data)))


def _portaudio() -> Any:
    try:
        import sounddevice  # noqa: PLC0415 - it loads the system's PortAudio, which only devices need
    except (ImportError, OSError) as error:
        raise DeviceError(f"sounddevice and PortAudio are needed for a microphone: {error}") from error
    return sounddevice
