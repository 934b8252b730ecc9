"""What a listener to streams got."""

from __future__ import annotations

from threading import Condition, current_thread

from contextpolicy.planning.conditions.sample import Sample
from contextpolicy.policy.stream_spec import Stream
from tests.waiting import PATIENCE

IMU = Stream("imu", "robot/imu")
MIC = Stream("mic", "robot/microphone")


class Heard:
    """What arrives, and on which thread; `wait_for` is bounded."""

    def __init__(self):
        self.inputs, self.drops, self.threads = [], [], set()
        self.full = False
        self._news = Condition()

    def on_next(self, event):
        with self._news:
            self.inputs.append(event)
            self.threads.add(current_thread().name)
            self._news.notify_all()

    def on_arrival(self, *sample):
        """What has not been decoded yet."""

    def admits(self, *_):
        return not self.full

    def on_drop(self, stream, reason):
        with self._news:
            self.drops.append((stream, reason))
            self.threads.add(current_thread().name)
            self._news.notify_all()

    def wait_for(self, condition):
        with self._news:
            assert self._news.wait_for(lambda: condition(self), PATIENCE), (self.inputs[-3:], self.drops[-3:])

    def values(self, stream="imu"):
        return [event.value for event in self.inputs if isinstance(event, Sample) and event.stream == stream]
