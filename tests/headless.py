"""A page in Debian's Chromium without a window, driven through the pipes of its DevTools protocol."""

import base64
import itertools
import json
import os
import select
import shutil
import subprocess
from collections import deque
from contextlib import contextmanager

CHROMIUM = shutil.which("chromium")
SECONDS = 60
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-background-networking --disable-component-update --no-first-run "
    "--disable-dev-shm-usage --remote-debugging-pipe"
)


class Page:
    """One tab.

    Attributes:
        complaints: errors of the console and exceptions.
        requests: addresses that were asked for, of documents and of everything else.
    """

    def __init__(self, browser, send, receive):
        self.complaints, self.requests = [], []
        self._browser, self._send, self._receive, self._buffer = browser, send, receive, b""
        self._numbers, self._events = itertools.count(1), deque()
        self._session = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method, **params):
        """The result of a command."""
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": params}
        message |= {"sessionId": self._session} if self._session else {}
        os.write(self._send, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._message()
            if answer.get("id") == number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]
            self._note(answer)

    def open(self, address):
        """Go there, and wait until it is loaded."""
        self._events.clear()
        self.call("Page.navigate", url=str(address))
        self.wait_for("Page.loadEventFired")

    def wait_for(self, event):
        """Wait until the browser reports this."""
        while event not in self._events:
            self._note(self._message())

    def run(self, expression):
        """The value of an expression of JavaScript, after it was awaited."""
        found = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def look(self, path, *, width=1200, height=900, dark=False, whole=False):
        """Write a picture of the page."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        found = self.call("Page.captureScreenshot", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(found["data"]))

    def _note(self, message):
        method, params = message.get("method"), message.get("params", {})
        self._events.append(method)
        if method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            self.complaints.append(params["exceptionDetails"])
        elif method == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.complaints.append(params["entry"])
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning"):
            self.complaints.append(params["args"])

    def _message(self):
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._receive], [], [], SECONDS)
            got = os.read(self._receive, 1 << 20) if ready else b""
            assert got, f"Chromium does not answer; it ended with {self._browser.poll()}"
            self._buffer += got
        text, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(text)


@contextmanager
def chromium(profile):
    """A tab of a browser that ends with the block.

    Args:
        profile: folder that the browser may write to.
    """
    (theirs_in, ours_out), (ours_in, theirs_out) = os.pipe(), os.pipe()

    def as_three_and_four():
        copies = [os.dup(end) for end in (theirs_in, theirs_out)]  # one of them may be 3 or 4
        for number, copy in enumerate(copies, 3):
            os.dup2(copy, number)

    command = [CHROMIUM, *FLAGS.split(), f"--user-data-dir={profile}"]
    browser = subprocess.Popen(
        command, close_fds=False, preexec_fn=as_three_and_four, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        os.close(theirs_in)
        os.close(theirs_out)
        yield Page(browser, ours_out, ours_in)
    finally:
        browser.terminate()
        browser.wait(SECONDS)
        os.close(ours_out)
        os.close(ours_in)
