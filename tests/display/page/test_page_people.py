"""A page of several people: all bodies, each in a colour and with a name of its own."""

import base64
import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from browser import Browser, find_browser
from shown import Recording, made_result
from synthetic import ring_rig

from mmocap_warp.display.overlay import Look
from mmocap_warp.display.page.viewer import view

PROGRAM = find_browser()
ANNA, BEN = Look("anna", (31, 210, 255)), Look("<ben>", (80, 200, 60))


@pytest.fixture(scope="module")
def people():
    """A result, and one of a person who stands beside the first."""
    first = replace(made_result(4), cameras=ring_rig(3, size=(320, 240)))
    return first, replace(first, pose=first.pose + np.r_[1.0, np.zeros(first.pose.shape[-1] - 1)])


class Mirrored(Recording):
    """Its masks are white on their right half."""

    def masks(self, scale, body):
        yield from ([mask[:, ::-1] for mask in views] for views in super().masks(scale, body))


@pytest.fixture(scope="module")
def page(people):
    scenes = Recording(people[0]), Mirrored(people[1])
    shown = [(look, *each) for look, each in zip((ANNA, BEN), zip(people, scenes, strict=True), strict=True)]
    return view(people[0], scenes[0], people=shown)


def test_a_page_holds_everybody(people, page):
    (data,) = re.findall(r'<script type="application/json" id="content">(.*?)</script>', page.html, re.S)
    content = json.loads(data)
    assert content["person"] == {"name": "anna", "colour": "#ffd21f"}
    (ben,) = content["others"]
    assert (ben["name"], ben["colour"]) == ("<ben>", "#3cc850")
    assert ben["body"] == content["body"]
    place = ben["motion"]["place"]
    steps = np.frombuffer(base64.b64decode(place["values"]["data"]), "<u2").reshape(4, -1, 3)
    places = place["low"] + place["step"] * steps
    np.testing.assert_allclose(places, people[1].joints()[people[1].best_run], rtol=0, atol=5e-5)
    mask = cv2.imdecode(np.frombuffer(base64.b64decode(content["cameras"][0]["masks"][0]), np.uint8), 0)
    assert mask.all()  # of both


@pytest.mark.skipif(PROGRAM is None, reason="no browser that can be driven")
def test_bodies_and_names_are_drawn(page, tmp_path):
    page.write(tmp_path / "page.html")
    with Browser(PROGRAM, tmp_path / "profile", "--enable-unsafe-swiftshader") as browser:
        browser.open(tmp_path / "page.html")
        for look_through in ("null", "1", "ALL"):
            browser.run(f"lookThrough({look_through})")
            browser.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            views = int(browser.run("views.length"))
            named = browser.run("[...part.labels.querySelectorAll('.person')].map((label) => label.textContent)")
            assert named.count("anna") == named.count("<ben>") == views
            data = browser.ask("Page.captureScreenshot", format="png")["data"]
            shown = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR).astype(float)
            for look in (ANNA, BEN):
                off = shown / shown.max(axis=2, keepdims=True).clip(1) - np.divide(look.colour, max(look.colour))
                assert ((np.abs(off).max(axis=2) < 0.2) & (shown.max(axis=2) > 60)).sum() > 100
        assert browser.run("stage.gl.getError()") == 0
        assert browser.told("Runtime.exceptionThrown") == []
