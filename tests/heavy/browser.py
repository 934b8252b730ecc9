"""Debian's chromium without a window, driven through its DevTools protocol."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path

import pytest
import websocket

PATIENCE = 120.0


class Browser:
    """One tab; `errors` are what its console complained about."""

    def __init__(self) -> None:
        program = shutil.which("chromium")
        if program is None:
            pytest.fail("chromium is not installed: run `make heavy`, which installs it", pytrace=False)
        self._profile = tempfile.mkdtemp()
        flags = [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--remote-debugging-port=0",
            "--remote-allow-origins=*",
        ]
        flags += ["--disable-dev-shm-usage", "--hide-scrollbars", f"--user-data-dir={self._profile}", "about:blank"]
        self._process = subprocess.Popen([program, *flags], stderr=subprocess.DEVNULL)
        self._tab = websocket.create_connection(self._address(), timeout=PATIENCE, suppress_origin=True)
        self._count = 0
        self.errors: list[str] = []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.hosts: set[str] = set()

    def close(self) -> None:
        self._tab.close()
        self._process.terminate()
        self._process.wait(PATIENCE)
        shutil.rmtree(self._profile, ignore_errors=True)

    def call(self, method, **parameters):
        """Call the browser; its events on the way to the answer are noted."""
        self._count += 1
        self._tab.send(json.dumps({"id": self._count, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._tab.recv())
            if message.get("id") == self._count:
                assert "error" not in message, message
                return message["result"]
            self._note(message)

    def open(self, address, width, height, *, phone=False):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=phone)
        self.call("Page.navigate", url=address)

    def value(self, expression):
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def wait_for(self, expression):
        deadline = time.monotonic() + PATIENCE
        while not self.value(f"Boolean({expression})"):
            assert time.monotonic() < deadline, f"never: {expression}\n{self.value('document.body.innerText')}"
            time.sleep(0.1)

    def picture(self, path, scheme="light"):
        """Keep what a reader sees who prefers light or dark pages."""
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        answer = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=True)
        Path(path).write_bytes(base64.b64decode(answer["data"]))

    def _address(self):
        port = Path(self._profile) / "DevToolsActivePort"
        deadline = time.monotonic() + PATIENCE
        while not port.exists() or "\n" not in port.read_text():
            assert time.monotonic() < deadline, "chromium does not start"
            time.sleep(0.1)
        [number, *_] = port.read_text().split("\n")
        with urllib.request.urlopen(f"http://127.0.0.1:{number}/json/list", timeout=PATIENCE) as answer:
            return next(tab for tab in json.load(answer) if tab["type"] == "page")["webSocketDebuggerUrl"]

    def _note(self, event):
        match event["method"]:
            case "Runtime.exceptionThrown":
                self.errors.append(json.dumps(event["params"]["exceptionDetails"])[:500])
            case "Log.entryAdded" if event["params"]["entry"]["level"] == "error":
                self.errors.append(event["params"]["entry"]["text"])
            case "Network.requestWillBeSent":
                self.hosts.add(event["params"]["request"]["url"].partition("?")[0].rsplit("/", 1)[0])
