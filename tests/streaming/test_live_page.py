"""The live page, in a browser: it draws what is sent to it, at once or smoothed."""

from __future__ import annotations

import time
from contextlib import closing

import numpy as np
import pytest
from browser import Browser, find_browser
from live_packet import RIG, SUBJECT, free_port, packet

from mmocap_warp.streaming.senders import open_sender

PROGRAM = find_browser()
NO_GPU = "--enable-unsafe-swiftshader"  # to draw in three dimensions nevertheless
TOLD = "document.getElementById('told').textContent"
# How many pixels of the canvas have not the background's colour, once it is drawn.
DRAWN = """new Promise((done) => { draw(); const { gl } = stage, { width, height } = gl.canvas;
  const seen = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, seen);
  done(seen.filter((value, i) => i % 4 === 2 && value > seen[i - 2] + 60).length); })"""


@pytest.mark.skipif(PROGRAM is None, reason="needs Chromium")
def test_the_page_draws_what_is_sent(tmp_path):
    pytest.importorskip("websockets")
    port = free_port()
    with (
        closing(open_sender(f"ws://127.0.0.1:{port}", {"": SUBJECT}, RIG, 30.0)) as sender,
        Browser(PROGRAM, tmp_path, NO_GPU) as browser,
    ):
        browser.ask("Page.navigate", url=f"http://127.0.0.1:{port}/")

        def told(wanted: str, smooth: bool) -> str:
            patience = time.monotonic() + 30.0
            while not (text := browser.run(f"document.readyState === 'complete' ? {TOLD} : ''")).startswith(wanted):
                assert time.monotonic() < patience, text
                sender.send(packet(smooth=smooth))
                time.sleep(0.02)
            return text

        assert told("Frame 7, partial, ", smooth=False).endswith(" ms after it was seen, 3 dropped")
        assert browser.run("document.getElementById('overlaps').innerText").split("\n") == [
            f"{RIG.names[0]}: IoU 0.910",
            f"{RIG.names[1]}: nothing seen",
        ]
        place = browser.run("[...people[0].joints.subarray(4, 7)]")
        np.testing.assert_allclose(place, packet().answer.joints[0, 0], atol=1e-4)
        assert browser.run(DRAWN) > 200  # the body is blue
        browser.run("part.smooth.click(); part.told.textContent = 'none'")
        told("Frame 7", smooth=True)
        assert browser.told("Runtime.exceptionThrown") == []
        assert [each for each in browser.told("Log.entryAdded") if each["entry"]["level"] == "error"] == []


@pytest.mark.skipif(PROGRAM is None, reason="needs Chromium")
def test_several_people_have_names_and_colours(tmp_path):
    pytest.importorskip("websockets")
    port, people = free_port(), {"anna": SUBJECT, "ben": SUBJECT}
    with (
        closing(open_sender(f"ws://127.0.0.1:{port}", people, RIG, 30.0)) as sender,
        Browser(PROGRAM, tmp_path, NO_GPU) as browser,
    ):
        browser.ask("Page.navigate", url=f"http://127.0.0.1:{port}/")
        patience = time.monotonic() + 30.0
        while "Frame 7, anna partial, ben partial, " not in browser.run(
            f"document.readyState === 'complete' ? {TOLD} : ''"
        ):
            assert time.monotonic() < patience
            for name in people:
                sender.send(packet(person=name))
            time.sleep(0.02)
        rows = browser.run("document.getElementById('overlaps').innerText").split("\n")
        assert rows[0] == f"{RIG.names[0]}: IoU anna 0.910, ben 0.910"
        assert len(set(browser.run("people.map((each) => each.colour)"))) == 2
        assert browser.told("Runtime.exceptionThrown") == []
