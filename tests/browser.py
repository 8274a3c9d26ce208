"""Headless Chromium through the HTTP interface of its driver (W3C WebDriver), as far as the tests need it."""

import json
import re
import shutil
import subprocess
import urllib.error
import urllib.request
from contextlib import contextmanager

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
needs_browser = pytest.mark.skipif(
    not (CHROMIUM and DRIVER), reason="no Chromium with its driver is on PATH (Debian: chromium, chromium-driver)"
)
ELEMENT = "element-6066-11e4-a52e-4f735466cecf"  # Key of an element, by the standard.


LOADED = "if (document.readyState !== 'complete') return new Promise((done) => addEventListener('load', () => done()))"


class Browser:
    """One window."""

    def __init__(self, session):
        self.session = session

    def call(self, command, **content):
        return _post(f"{self.session}/{command}", content)

    def open(self, path, *, width=1200, height=900, dark=False):
        """Opens a file in a window of this size and scheme, and clears the logs."""
        features = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.devtools("Emulation.setEmulatedMedia", features=features)
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.devtools("Emulation.setDeviceMetricsOverride", **size)
        self.log("browser"), self.log("performance")
        self.call("url", url=path.resolve().as_uri())
        # A browser that has just started may answer before the page's scripts have run.
        self.run(LOADED)

    def devtools(self, command, **parameters):
        return self.call("goog/cdp/execute", cmd=command, params=parameters)

    def run(self, script, *arguments):
        return self.call("execute/sync", script=script, args=list(arguments))

    def element(self, selector):
        return self.call("element", using="css selector", value=selector)[ELEMENT]

    def click(self, selector):
        self.call(f"element/{self.element(selector)}/click")

    def type(self, selector, keys):
        self.call(f"element/{self.element(selector)}/value", text=keys)

    def drag(self, selector, start, end):
        """Scrolls to the element and drags the mouse within it, between distances from its centre in pixels."""
        self.run(f"document.querySelector({json.dumps(selector)}).scrollIntoView({{block: 'center'}})")
        move = {"type": "pointerMove", "duration": 50, "origin": {ELEMENT: self.element(selector)}}
        there, back = ({**move, "x": x, "y": y} for x, y in (start, end))
        down, up = ({"type": kind, "button": 0} for kind in ("pointerDown", "pointerUp"))
        self.call("actions", actions=[{"type": "pointer", "id": "mouse", "actions": [there, down, back, up]}])

    def log(self, kind):
        return [entry["message"] for entry in self.call("se/log", type=kind)]

    def requests(self):
        """Addresses requested since the page was opened."""
        events = [json.loads(message)["message"] for message in self.log("performance")]
        return [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]


@contextmanager
def browser():
    """Yields a browser that ends with the block."""
    driver = subprocess.Popen([DRIVER, "--port=0"], stdout=subprocess.PIPE, text=True)
    try:
        matches = (re.search(r"successfully on port (\d+)", line) for line in driver.stdout)
        port = next(match[1] for match in matches if match)
        # Containers have no sandbox for root and little shared memory.
        arguments = ["--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu"]
        capabilities = {
            "browserName": "chrome",
            "goog:chromeOptions": {"binary": CHROMIUM, "args": arguments},
            "goog:loggingPrefs": {"browser": "ALL", "performance": "ALL"},
        }
        root = f"http://127.0.0.1:{port}/session"
        session = f"{root}/{_post(root, {'capabilities': {'alwaysMatch': capabilities}})['sessionId']}"
        yield Browser(session)
        _send(urllib.request.Request(session, method="DELETE"))
    finally:
        driver.terminate()
        driver.wait()
        driver.stdout.close()


def _post(address, content):
    data = json.dumps(content).encode()
    return _send(urllib.request.Request(address, data, {"Content-Type": "application/json"}))


def _send(request):
    # The environment's proxies do not apply to the driver on this machine.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(request, timeout=60) as answer:
            return json.loads(answer.read())["value"]
    except urllib.error.HTTPError as error:
        raise AssertionError(json.loads(error.read())["value"]["message"]) from None
