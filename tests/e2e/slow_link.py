"""A slow way to a server: what it answers arrives late, what it is asked passes at once."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import Future
from contextlib import closing, contextmanager, suppress
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterator

Address: TypeAlias = tuple[str, int]


class SlowLink:
    """A TCP proxy in front of `target`; every chunk of its answers takes `delay` seconds more, one beside the other."""

    def __init__(self, target: Address) -> None:
        self._target = target
        self.delay = 0.0

    async def serve(self, host: str, begun: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event, int]]) -> None:
        """Listen until what `begun` gives is set."""
        stop, server = asyncio.Event(), await asyncio.start_server(self.connected, host, 0)
        begun.set_result((asyncio.get_running_loop(), stop, server.sockets[0].getsockname()[1]))
        await stop.wait()
        server.close()

    async def connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """A client has come."""
        with closing(writer), suppress(OSError):
            answers, asked = await asyncio.open_connection(*self._target)
            await asyncio.gather(self._pass(reader, asked, late=False), self._pass(answers, writer, late=True))

    async def _pass(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter, *, late: bool) -> None:
        """All that comes, then the end; both only when it is due."""
        loop, under_way = asyncio.get_running_loop(), asyncio.Queue[tuple[float, bytes]]()
        delivery = asyncio.create_task(_deliver(under_way, sink))
        while True:
            chunk = await _read(source)
            await under_way.put((loop.time() + (self.delay if late else 0.0), chunk))
            if not chunk:
                break
        await delivery


async def _read(source: asyncio.StreamReader) -> bytes:
    """Empty at the end, however it came."""
    with suppress(OSError):
        return await source.read(65536)
    return b""


async def _deliver(under_way: asyncio.Queue[tuple[float, bytes]], sink: asyncio.StreamWriter) -> None:
    loop, chunk = asyncio.get_running_loop(), b"-"
    with closing(sink), suppress(OSError):
        while chunk:
            due, chunk = await under_way.get()
            await asyncio.sleep(max(0.0, due - loop.time()))
            if chunk:
                sink.write(chunk)
                await sink.drain()


@contextmanager
def slow_link(host: str, target: Address) -> Iterator[tuple[SlowLink, int]]:
    """A link that listens at `host`, and its port."""
    link, begun = SlowLink(target), Future[tuple[asyncio.AbstractEventLoop, asyncio.Event, int]]()
    thread = threading.Thread(target=lambda: asyncio.run(link.serve(host, begun)), daemon=True)
    thread.start()
    loop, stop, port = begun.result(10)
    try:
        yield link, port
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join(10)
