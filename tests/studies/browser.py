"""A headless Chromium, driven by its own driver over HTTP: no package is needed."""

import base64
import contextlib
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request

FLAGS = [
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars",
]  # fmt: skip


def missing():
    """Why there is no browser, or an empty string."""
    lacks = [name for name in ("chromium", "chromedriver") if shutil.which(name) is None]
    return f"there is no {' and no '.join(lacks)} here" if lacks else ""


class Browser:
    """One window."""

    def __init__(self, port, more=()):
        self.port, self.session = port, ""
        options = {
            "args": [*FLAGS, f"--user-data-dir={tempfile.mkdtemp()}", *more],
            "binary": shutil.which("chromium"),
        }
        wanted = {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
        self.session = "/" + self.call("POST", "", {"capabilities": {"alwaysMatch": wanted}})["sessionId"]

    def call(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(
            f"http://127.0.0.1:{self.port}/session{self.session}{path}",
            data,
            {"Content-Type": "application/json"},
            method=method,
        )
        with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(request, timeout=60) as answer:
            return json.load(answer)["value"]

    def cdp(self, command, **parameters):
        return self.call("POST", "/goog/cdp/execute", {"cmd": command, "params": parameters})

    def open(self, path, width, height, touch=False):
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": touch}
        self.cdp("Emulation.setDeviceMetricsOverride", **metrics)
        self.cdp("Emulation.setTouchEmulationEnabled", enabled=touch)
        self.call("POST", "/url", {"url": path.absolute().as_uri()})

    def media(self, kind="", scheme="light", motion="reduce"):
        features = {"prefers-color-scheme": scheme, "prefers-reduced-motion": motion}
        wanted = [{"name": name, "value": value} for name, value in features.items()]
        self.cdp("Emulation.setEmulatedMedia", media=kind, features=wanted)

    def run(self, script):
        return self.call("POST", "/execute/sync", {"script": script, "args": []})

    def frame(self):
        """Wait until the page has drawn."""
        script = "const end = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(() => end()));"
        self.call("POST", "/execute/async", {"script": script, "args": []})

    def finger(self, *points):
        """Put a finger down, move it and lift it."""
        for k, (x, y) in enumerate(points):
            kind = "touchMove" if k else "touchStart"
            self.cdp("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y}])
        self.cdp("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def click(self, x, y, *more):
        """Press the mouse at a place of the page, and lift it there, or drag it on."""
        move = [{"type": "pointerMove", "x": int(x), "y": int(y), "duration": 20} for x, y in ((x, y), *more)]
        down, up = {"type": "pointerDown", "button": 0}, {"type": "pointerUp", "button": 0}
        actions = [move[0], down, *move[1:], up]
        mouse = {"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": actions}
        self.call("POST", "/actions", {"actions": [mouse]})

    def press(self, key):
        keys = [{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]
        self.call("POST", "/actions", {"actions": [{"type": "key", "id": "keys", "actions": keys}]})

    def messages(self):
        return self.call("POST", "/se/log", {"type": "browser"})

    def screenshot(self, path):
        path.write_bytes(base64.b64decode(self.call("GET", "/screenshot")))


@contextlib.contextmanager
def browser():
    """A browser, ended with the context."""
    driver = subprocess.Popen(
        ["chromedriver", "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        port = next(
            int(line.rstrip(".\n").rsplit(" ", 1)[1])
            for line in driver.stdout
            if "started successfully on port" in line
        )
        time.sleep(0.1)
        window = Browser(port)
        try:
            yield window
        finally:
            window.call("DELETE", "")
    finally:
        driver.kill()  # a parent that ignores SIGTERM hands that on
        driver.wait()
