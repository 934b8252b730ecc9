"""Publishes results, each with its stamp; a result that the bus can't take at once is dropped.

The newest one is kept for tasks that resume a moment later (`newest`), except as a ROS message: ROS has latched topics.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Mapping
from typing import TYPE_CHECKING

import zenoh

from robotkit import json_text
from robotkit.newest import Newest
from robotkit.ros_outputs import fields_of
from robotkit.session import SHARED_FROM
from robotkit.stamps import attachment, ros_attachment
from robotkit.task import Result

if TYPE_CHECKING:
    from collections.abc import Iterable

    from robotkit.module import Output
    from robotkit.task import Results

JSON, CDR = "json", "cdr"


def as_results(results: Results, outputs: Iterable[str]) -> Iterable[Result]:
    """Results as `Result` objects; a plain mapping goes to the only output, TypeError when there are several."""
    if results is None:
        return ()
    if not isinstance(results, Mapping):
        return results
    names = list(outputs)
    if len(names) != 1:
        raise TypeError(f"a mapping is only for a module with one output, but this one has {names}: return Results")
    return (Result(names[0], results),)


def publisher(session: zenoh.Session, key: str, encoding: str) -> zenoh.Publisher:
    """A publisher that never blocks: a subscriber without CPU must not stall its publisher."""
    known = {JSON: zenoh.Encoding.APPLICATION_JSON, CDR: zenoh.Encoding.APPLICATION_CDR}
    return session.declare_publisher(
        key,
        encoding=known.get(encoding, zenoh.Encoding.ZENOH_BYTES),
        congestion_control=zenoh.CongestionControl.DROP,
        express=True,
    )


class Outputs:
    """Publishes results under the keys of module.yaml; with `shared_memory` frames have checksums."""

    def __init__(self, session: zenoh.Session, declared: Mapping[str, Output], *, shared_memory: bool) -> None:
        self._shared_memory = shared_memory
        self._declared = declared
        self._ids = {name: uuid.uuid4().bytes for name in declared}
        self._numbers = dict.fromkeys(declared, 0)
        self._publishers = {
            name: publisher(session, declaration.key, declaration.encoding) for name, declaration in declared.items()
        }
        self._newest = {
            name: Newest(session, one.key, self._publishers[name].encoding)
            for name, one in declared.items()
            if one.encoding != CDR
        }

    def publish(self, result: Result, timing: Mapping[str, object] | None = None) -> None:
        """Publish a result; JSON also gets its `stamp`, and `timing` if given. KeyError for an unknown output.

        A result that says nothing as a ROS message, such as a pose that is lost, is left out.
        """
        if result.output not in self._declared:
            raise KeyError(
                f"unknown output {result.output!r}: expected one of module.yaml: {', '.join(self._declared)}"
            )
        now = time.time_ns()
        stamp = now if result.stamp is None else result.stamp
        payload = _payload(result, self._declared[result.output], stamp, timing)
        if payload is None:
            return
        attached = self._attachment(result.output, now, payload)
        self._publishers[result.output].put(payload, attachment=attached)
        if newest := self._newest.get(result.output):
            newest.keep(payload, attached)

    def _attachment(self, output: str, now: int, payload: bytes) -> bytes:
        """Our own attachment, or for ROS messages that of rmw_zenoh, which rejects messages without it."""
        if self._declared[output].encoding != CDR:
            shared = self._shared_memory and len(payload) >= SHARED_FROM
            return attachment(now, payload if shared else None)
        self._numbers[output] += 1
        return ros_attachment(self._numbers[output], now, self._ids[output])


def _payload(result: Result, output: Output, stamp: int, timing: Mapping[str, object] | None) -> bytes | None:
    if output.encoding == CDR:
        from robotkit.ros import encode  # noqa: PLC0415 - an extra, and megabytes

        fields, source = fields_of(result.value, output), {"release": output.ros, "folder": output.types}
        if fields is None:
            return None
        return encode(fields, output.type, stamp=stamp, frame=output.frame, **source)
    if isinstance(result.value, bytes):
        return result.value
    if output.encoding != JSON:
        raise TypeError(f"output {result.output} has the encoding {output.encoding}: its values must be bytes")
    return json_text.dumps({"stamp": stamp, **result.value} | ({} if timing is None else {"timing": timing})).encode()
