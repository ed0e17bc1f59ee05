# SPDX-License-Identifier: GPL-3.0-or-later
"""A headless Chromium that opens pages, runs scripts in them and tells what went wrong, by the DevTools protocol."""

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

# Until the page's own script has shown what it reads.
READY = """(async () => {
  for (let tries = 0; document.documentElement.dataset.ready === undefined; tries++) {
    if (tries > 4000) throw new Error("the page is not ready");
    await new Promise((go) => setTimeout(go, 25));
  }
})()"""

# Until the window has the width and the page was told so: what a page does about it comes before the next picture.
SIZED = """(async () => {
  const picture = () => new Promise((go) => requestAnimationFrame(go));
  for (let tries = 0; innerWidth !== %d; tries++) {
    if (tries > 4000) throw new Error(`the window is ${innerWidth} px wide`);
    await picture();
  }
  await picture();
  await picture();
})()"""

NAMES = ("chromium", "chromium-browser", "google-chrome")


def find_chromium() -> str | None:
    """Return the program, or None where there is none."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


class Tab:
    """A page of a browser: commands go through one pipe, answers and events come through another."""

    def __init__(self, write: int, read: int) -> None:
        self._write, self._read = write, read
        self._rest = b""
        self._number = 0
        self._session: str | None = None
        self._events: list[dict[str, Any]] = []
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Give a command and return its result; events on the way are kept."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        message |= {"sessionId": self._session} if self._session else {}
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while (answer := self._receive()).get("id") != self._number:
            self._events.append(answer)
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']['message']}")
        return answer["result"]

    def size(self, width_px: int, height_px: int = 900) -> None:
        """Set the size of the window, and wait until the page has it."""
        shape = {"width": width_px, "height": height_px, "deviceScaleFactor": 1, "mobile": False}
        self.send("Emulation.setDeviceMetricsOverride", **shape)
        self.run(SIZED % width_px)

    def open(self, url: str) -> None:
        """Open a page and wait until it and what it names are loaded."""
        self._events.clear()
        self.send("Page.navigate", url=url)
        while not any(event.get("method") == "Page.loadEventFired" for event in self._events):
            self._events.append(self._receive())

    def run(self, script: str) -> Any:
        """Return what an expression, or a promise, comes to. Raises RuntimeError where it throws."""
        found = self.send("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in found:
            raise RuntimeError(found["exceptionDetails"].get("exception", {}).get("description", "the script failed"))
        return found["result"].get("value")

    def complaints(self) -> list[str]:
        """Return the errors and warnings of the page since it was opened."""
        return [text for event in self._events if (text := complaint(event))]

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            if not (more := os.read(self._read, 1 << 20)):
                raise RuntimeError("the browser ended")
            self._rest += more
        message, self._rest = self._rest.split(b"\0", 1)
        return json.loads(message)


def complaint(event: dict[str, Any]) -> str:
    """Return what an event says went wrong, or nothing."""
    given = event.get("params", {})
    match event.get("method"):
        case "Runtime.exceptionThrown":
            details = given["exceptionDetails"]
            return details.get("exception", {}).get("description") or details["text"]
        case "Log.entryAdded" if given["entry"]["level"] == "error":
            return f"{given['entry']['text']} {given['entry'].get('url', '')}"
        case "Runtime.consoleAPICalled" if given["type"] in ("error", "assert"):
            return " ".join(str(value.get("value")) for value in given["args"])
        case "Network.requestWillBeSent" if given["request"]["url"].startswith("http"):
            return f"fetches {given['request']['url']}"
    return ""


@contextmanager
def browser() -> Iterator[Tab]:
    """Start Chromium and yield a tab of it."""
    program = find_chromium()
    assert program is not None
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as home:
        to_browser, write = os.pipe()
        read, from_browser = os.pipe()

        def place() -> None:  # where Chromium looks for its pipes
            os.dup2(from_browser, 19)
            os.dup2(to_browser, 3)
            os.dup2(19, 4)

        options = [
            "--headless",
            "--remote-debugging-pipe",
            "--disable-gpu",
            "--no-first-run",
            f"--user-data-dir={home}",
        ]
        options += ["--no-sandbox"] if os.geteuid() == 0 else []
        log = (Path(home) / "log").open("wb")
        process = subprocess.Popen([program, *options], preexec_fn=place, pass_fds=(3, 4), stderr=log)  # noqa: PLW1509
        os.close(to_browser)
        os.close(from_browser)
        try:
            yield Tab(write, read)
        finally:
            os.close(write)
            os.close(read)
            process.terminate()
            process.wait(timeout=300)
