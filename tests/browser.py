"""Browsers that tests may drive: Chromium and Firefox, over their own protocols; no driver and no library is needed."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import socket
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
_PATIENCE = 60.0  # [s]


def find_browser() -> str | None:
    """The program, or None where there is none."""
    return next((path for name in _NAMES if (path := shutil.which(name))), None)


def find_firefox() -> str | None:
    """The program, or None where there is none."""
    return shutil.which("firefox") or shutil.which("firefox-esr")


def _find_axe() -> Path | None:
    """axe-core's script, where node would find it: in ``NODE_PATH`` or in a folder ``node_modules`` of the checkout."""
    folders = [
        *filter(None, os.environ.get("NODE_PATH", "").split(os.pathsep)),
        Path(__file__).parents[1] / "node_modules",
    ]
    return next((path for folder in folders if (path := Path(folder) / "axe-core" / "axe.min.js").exists()), None)


AXE = _find_axe()


def violations(browser: Browser | Firefox) -> list[list[str]]:
    """What axe finds against a page: each rule with the elements that break it."""
    found = "violations.map(({ id, nodes }) => [id, ...nodes.map((node) => node.html.slice(0, 100))])"
    run = f"axe.run(document, {{resultTypes: ['violations']}}).then(({{ violations }}) => {found})"
    return browser.run(f"(() => {{ {AXE.read_text(encoding='utf-8')}; return {run}; }})()")


class Browser:
    """One page of a browser of its own, with a profile that is thrown away; ``further`` flags may be given.

    Attributes:
        events: (method, parameters) of all that it has told.
    """

    def __init__(self, program: str, profile: Path, *further: str) -> None:
        to_it, from_it = os.pipe(), os.pipe()
        theirs = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (to_it[0], from_it[1])]
        # The browser reads commands from descriptor 3 and answers on 4.
        script = f'exec "$@" 3<&{theirs[0]} 4>&{theirs[1]}'
        flags = (
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--no-first-run",
            *further,
        )
        self._process = subprocess.Popen(
            ["bash", "-c", script, "bash", program, *flags, f"--user-data-dir={profile}", "--remote-debugging-pipe"],
            pass_fds=theirs,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for end in (to_it[0], from_it[1], *theirs):
            os.close(end)
        self._to_it, self._from_it = to_it[1], from_it[0]
        self._left, self._number = b"", 0
        self.events: list[tuple[str, dict[str, Any]]] = []
        self._session: str | None = None
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for end in (self._to_it, self._from_it):
            os.close(end)
        self._process.terminate()
        self._process.wait()

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the DevTools protocol and wait for its answer."""
        self._number += 1
        call = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            call["sessionId"] = self._session
        os.write(self._to_it, json.dumps(call).encode() + b"\0")
        while True:
            message = self._next()
            if message.get("id") == self._number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']['message']}")
                return message["result"]

    def open(self, page: Path) -> None:
        """Load a file and wait until it is there; what was told of another one before is forgotten."""
        self.events.clear()
        self.ask("Page.navigate", url=page.resolve().as_uri())
        while ("Page.loadEventFired", None) not in [(method, None) for method, _ in self.events]:
            self._next()

    def run(self, expression: str) -> Any:
        """The value of a JavaScript expression in the page."""
        answer = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"]["exception"]["description"])
        return answer["result"].get("value")

    def told(self, method: str) -> list[dict[str, Any]]:
        """The parameters of all events of a kind so far."""
        self.run("0")  # what happened before this answer has arrived before it
        return [parameters for name, parameters in self.events if name == method]

    def _next(self) -> dict[str, Any]:
        """The next message; events are kept."""
        give_up = time.monotonic() + _PATIENCE
        while b"\0" not in self._left:
            ready, _, _ = select.select([self._from_it], [], [], max(give_up - time.monotonic(), 0.0))
            data = os.read(self._from_it, 1 << 20) if ready else b""
            if not data:
                raise RuntimeError("the browser has ended" if ready else "the browser does not answer")
            self._left += data
        line, self._left = self._left.split(b"\0", 1)
        message = json.loads(line)
        if "method" in message:
            self.events.append((message["method"], message.get("params", {})))
        return message


class Firefox:
    """One page of a Firefox, over Marionette, which every Firefox speaks; expressions see the DOM alone.

    A headless Firefox draws nothing in three dimensions without a GPU, so it gets a display where there is Xvfb.

    Attributes:
        draws: whether it has a display.
    """

    def __init__(self, program: str, profile: Path) -> None:
        (profile / "user.js").write_text('user_pref("marionette.port", 0);\nuser_pref("webgl.force-enabled", true);\n')
        flags = ["--marionette", "--no-remote", "--profile", str(profile)]
        nowhere = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        environment, self._display = dict(os.environ), None
        self.draws = shutil.which("Xvfb") is not None
        if self.draws:
            told, tells = os.pipe()
            screen = ["Xvfb", "-displayfd", str(tells), "-screen", "0", "1600x1200x24"]
            self._display = subprocess.Popen(screen, pass_fds=[tells], **nowhere)
            os.close(tells)
            with os.fdopen(told) as number:
                environment |= {"DISPLAY": f":{number.readline().strip()}", "LIBGL_ALWAYS_SOFTWARE": "1"}
        else:
            flags.append("--headless")
        self._process = subprocess.Popen([program, *flags], env=environment, **nowhere)
        place, give_up = profile / "MarionetteActivePort", time.monotonic() + _PATIENCE
        while not (place.exists() and place.read_text().strip()):
            if time.monotonic() > give_up or self._process.poll() is not None:
                raise RuntimeError("Firefox does not answer")
            time.sleep(0.1)
        self._socket = socket.create_connection(("127.0.0.1", int(place.read_text())), timeout=_PATIENCE)
        self._stream, self._number = self._socket.makefile("rb"), 0
        self._next()  # it says who it is
        self.ask("WebDriver:NewSession")

    def __enter__(self) -> Firefox:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._stream.close()
        self._socket.close()
        for process in filter(None, (self._process, self._display)):
            process.terminate()
            process.wait()

    def ask(self, command: str, **parameters: Any) -> Any:
        """Give a command of WebDriver's and wait for its answer."""
        self._number += 1
        text = json.dumps([0, self._number, command, parameters])
        self._socket.sendall(f"{len(text)}:{text}".encode())
        _, _, error, answer = self._next()
        if error:
            raise RuntimeError(f"{command}: {error['message']}")
        return answer

    def open(self, page: Path) -> None:
        """Load a file and wait until it is there."""
        self.ask("WebDriver:Navigate", url=page.resolve().as_uri())

    def run(self, expression: str) -> Any:
        """The value of a JavaScript expression of the document, or what it promises."""
        script = f"const done = arguments[arguments.length - 1]; Promise.resolve({expression}).then(done)"
        return self.ask("WebDriver:ExecuteAsyncScript", script=script, args=[])["value"]

    def press(self, keys: str) -> None:
        """Press keys, one after the other."""
        strokes = [{"type": kind, "value": key} for key in keys for kind in ("keyDown", "keyUp")]
        self.ask("WebDriver:PerformActions", actions=[{"type": "key", "id": "keys", "actions": strokes}])

    def picture(self) -> bytes:
        """The window as PNG."""
        return base64.b64decode(self.ask("WebDriver:TakeScreenshot", full=False)["value"])

    def _next(self) -> Any:
        length = b""
        while (digit := self._stream.read(1)) != b":":
            length += digit
        return json.loads(self._stream.read(int(length)))
