"""Chromium without a window, driven by its debugging protocol over a pair of pipes."""

from __future__ import annotations

import fcntl
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

PROGRAM = shutil.which("chromium")
_TIMEOUT = 60.0  # [s]
_ERRORS = ("Runtime.exceptionThrown", "Log.entryAdded", "Runtime.consoleAPICalled")


class Page:
    """A page that was opened; `errors` are exceptions, console output, and the browser's own."""

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._to, self._from = to_browser, from_browser
        self._rest = b""
        self._number = 0
        self._session: str | None = None
        self._seen: set[str] = set()
        self.errors: list[str] = []

    def open(self, path: Path, width: int, height: int, touch: bool) -> None:
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **screen)
        self.call("Emulation.setTouchEmulationEnabled", enabled=touch)
        self._seen.clear()
        self.call("Page.navigate", url=path.resolve().as_uri())
        while "Page.loadEventFired" not in self._seen:
            self._receive()

    def evaluate(self, script: str) -> Any:
        """The value of an expression in the page."""
        answer = self.call("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return dict(answer["result"])

    def _receive(self) -> dict[str, Any]:
        end = time.monotonic() + _TIMEOUT
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._from], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"the browser says nothing for {_TIMEOUT:g} s"
            data = os.read(self._from, 1 << 16)
            assert data, "the browser is gone"
            self._rest += data
        text, _, self._rest = self._rest.partition(b"\0")
        message: dict[str, Any] = json.loads(text)
        name = message.get("method", "")
        self._seen.add(name)
        if name in _ERRORS:
            self.errors.append(json.dumps(message["params"]))
        return message


@contextmanager
def opened(path: Path, width: int = 1100, height: int = 800, touch: bool = False) -> Iterator[Page]:
    """A page in a separate browser; with `touch` it is a device without a mouse."""
    assert PROGRAM is not None
    hears, to_browser = os.pipe()
    from_browser, says = os.pipe()

    def pipes() -> None:  # the browser reads from 3 and writes to 4
        first, second = (fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (hears, says))
        os.dup2(first, 3)
        os.dup2(second, 4)

    with tempfile.TemporaryDirectory(
        prefix="ballscrew-browser-", ignore_cleanup_errors=True
    ) as profile:
        options = "--headless --no-sandbox --disable-gpu --disable-dev-shm-usage --no-first-run "
        options += "--disable-background-networking --remote-debugging-pipe"
        command = [PROGRAM, *options.split(), f"--user-data-dir={profile}"]
        quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
        with subprocess.Popen(
            command, stderr=subprocess.DEVNULL, preexec_fn=pipes, close_fds=False, **quiet
        ) as process:
            os.close(hears)
            os.close(says)
            try:
                page = Page(to_browser, from_browser)
                page.open(path, width, height, touch)
                yield page
            finally:
                process.terminate()
                process.wait(_TIMEOUT)
                os.close(to_browser)
                os.close(from_browser)
