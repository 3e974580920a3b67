"""The page in a browser, where there is one: what it holds is tested everywhere, see test_page.py.

WebGL is drawn by the processor here, which says nothing about how fast a GPU is.
"""

import base64
import tomllib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from browser import AXE, Browser, Firefox, find_browser, find_firefox, violations
from shown import Recording, made_result
from synthetic import ring_rig

from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import project
from mmocap_warp.cameras.silhouette import silhouette
from mmocap_warp.display.page.viewer import view
from mmocap_warp.result.truth import Truth

PROGRAM = find_browser()
FRAMES = 8
NO_GPU = "--enable-unsafe-swiftshader"  # to draw in three dimensions nevertheless
DRAWN = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 100))))"


@pytest.fixture(scope="module")
def result():
    """Two runs, one better than the other; of each a raw track and a smoothed one."""
    made = made_result(FRAMES)
    return replace(made, cameras=ring_rig(3, size=(320, 240)), frame_numbers=made.frame_numbers * 3)


@pytest.fixture(scope="module")
def page(result, tmp_path_factory):
    names = result.subject.body.skeleton.joints
    truth = Truth(result.fps, result.frame_numbers, (), np.zeros((FRAMES, 0, 3)), names, result.joints()[1] + 0.01)
    path = tmp_path_factory.mktemp("page") / "page.html"
    view(result, Recording(result), truth=truth, images=True, name="A walk").write(path)
    return path


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    """A browser that all tests share; each opens the page anew."""
    with Browser(PROGRAM, tmp_path_factory.mktemp("profile"), NO_GPU) as browser:
        yield browser


@pytest.fixture
def browser(started, page):
    resize(started, 1280, 800)
    emulate(started)
    started.open(page)
    started.run(DRAWN)
    yield started
    assert started.told("Runtime.exceptionThrown") == []


def emulate(browser, **features):
    """Let the browser's user prefer something, such as ``prefers_color_scheme="dark"``."""
    named = [{"name": name.replace("_", "-"), "value": value} for name, value in features.items()]
    browser.ask("Emulation.setEmulatedMedia", media="", features=named)


def resize(browser, width, height):
    browser.ask(
        "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
    )


def press(browser, key, shift=False):
    for kind in ("keyDown", "keyUp"):
        browser.ask("Input.dispatchKeyEvent", type=kind, key=key, modifiers=8 if shift else 0)


def click(browser, selector, across=0.5):
    """Press the mouse on an element, at a share of its width."""
    x, y = browser.run(
        f"""(() => {{
            const box = document.querySelector('{selector}').getBoundingClientRect();
            return [box.left + {across} * box.width, box.top + box.height / 2];
        }})()"""
    )
    for kind, buttons in (("mousePressed", 1), ("mouseReleased", 0)):
        browser.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=buttons, clickCount=1)


def frame(browser):
    browser.run(DRAWN)
    return browser.run("part.where.textContent")


def world(browser):
    """What the canvas shows, (row, column, 3) uint8."""
    browser.run(DRAWN)
    box = browser.run("(({x, y, width, height}) => ({x, y, width, height}))(part.world.getBoundingClientRect())")
    data = browser.ask("Page.captureScreenshot", format="png", clip=box | {"scale": 1})["data"]
    return cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]


def test_it_draws_without_an_error_and_asks_nobody(browser, page):
    requests = [request["request"]["url"] for request in browser.told("Network.requestWillBeSent")]
    assert [url for url in requests if not url.startswith("data:")] == [page.resolve().as_uri()]
    assert browser.told("Runtime.consoleAPICalled") == []
    # A browser without a GPU warns that it reads pixels back.
    assert [entry for entry in browser.told("Log.entryAdded") if entry["entry"]["level"] == "error"] == []
    assert browser.run("part.trouble.hidden")
    assert browser.run("stage.gl.getError()") == 0


@pytest.mark.parametrize("track", ["final", "raw"])
def test_a_camera_sees_the_skin_where_it_projects(browser, result, track):
    """Pixel by pixel: the shader bends the skin as Python does, and looks through the camera as OpenCV does."""
    browser.run("drawPictures = () => 0; cameraLines = () => []; skeletonLines = () => []; part.free.style.opacity = 0")
    pose = result.pose if track == "final" else result.raw_pose
    if track == "raw":
        press(browser, "r")
    press(browser, "2")
    browser.run("seek(3)")
    shown = world(browser).astype(int)
    height, width = shown.shape[:2]
    subject = result.subject
    (vertices,) = Poser(subject.body, subject.root_base).vertices(pose[result.best_run, 3])
    scale = min(width / 320, height / 240)
    offset = (np.array([width, height]) - scale * np.array([320, 240])) / 2
    pixels = (project(result.cameras, vertices)[1] + 0.5) * scale + offset - 0.5
    face = subject.body.skin.face
    expected = silhouette(pixels, np.concatenate([face[:, [0, 1, 2]], face[:, [0, 2, 3]]]), (width, height)) > 0
    drawn = shown[..., 2] - shown[..., 0] > 12  # the skin is blue, what is behind it gray
    assert expected.mean() > 0.02
    assert (drawn & expected).sum() / (drawn | expected).sum() > 0.97


@pytest.mark.parametrize("sign", [1, -1])
def test_between_two_frames_a_joint_is_halfway(browser, sign):
    """A quaternion and its negative are one rotation; here one of a quarter turn about z."""
    quarter = round(32767 * np.sqrt(0.5))
    half = browser.run(
        f"""[...Object.assign(Object.create(Track.prototype), {{
            joints: 1,
            turn: new Int16Array([0, 0, 0, 32767, 0, 0, {sign * quarter}, {sign * quarter}]),
            place: new Uint16Array([0, 0, 0, 100, 0, 0]),
            low: [1, 2, 3],
            step: 0.01,
        }}).at(0.5, new Float32Array(8))]"""
    )
    np.testing.assert_allclose(half[:4], [0, 0, np.sin(np.pi / 8), np.cos(np.pi / 8)], atol=1e-4)
    np.testing.assert_allclose(half[4:7], [1.5, 2, 3], rtol=1e-6)


def test_keys_play_step_and_choose(browser):
    assert frame(browser) == "Frame 30, 0.00 s, tracked"
    press(browser, "ArrowRight")
    assert frame(browser) == "Frame 33, 0.05 s, partial"
    press(browser, "End")
    assert frame(browser) == "Frame 51, 0.35 s, lost"
    press(browser, "ArrowLeft")
    assert frame(browser).startswith("Frame 48")
    press(browser, "Home")
    press(browser, " ")
    assert browser.run("part.play.textContent") == "Pause"
    browser.run(  # a busy machine draws its first picture late
        """new Promise((done) => {
            const last = Date.now() + 10000;
            const look = () => (state.position > 0 || Date.now() > last ? done() : setTimeout(look, 20));
            look();
        })"""
    )
    assert browser.run("state.position") > 0
    press(browser, " ")
    assert browser.run("[part.play.textContent, state.position % 1]") == ["Play", 0]
    press(browser, "3")
    assert browser.run("tiles.map((tile) => tile.button.ariaPressed)") == ["false", "false", "true"]
    press(browser, "Escape")
    assert browser.run("state.through") is None
    press(browser, "r")
    assert browser.run("[part.raw.checked, trackName()]") == [True, "raw"]
    before = browser.run("[orbit.heading, orbit.distance]")
    press(browser, "ArrowLeft", shift=True)
    press(browser, "+")
    heading, distance = browser.run("[orbit.heading, orbit.distance]")
    assert heading < before[0]
    assert distance < before[1]


def test_every_control_is_reached_by_tab_and_its_focus_is_seen(browser):
    reached = []
    for _ in range(20):
        for kind in ("rawKeyDown", "keyUp"):
            browser.ask("Input.dispatchKeyEvent", type=kind, key="Tab", code="Tab", windowsVirtualKeyCode=9)
        name, outline = browser.run(
            """(({id, localName}, style) => [id || localName, style.outlineStyle])(
                document.activeElement, getComputedStyle(document.activeElement))"""
        )
        if name != "body":
            assert outline == "solid", name
        reached.append(name)
    layers = {"mask", "mesh", "skeleton", "deviations", "truth", "names", "raw"}
    assert {"world", "play", "slider", "speed", "run", "all", "reset", "button", "summary"} | layers <= set(reached)


def test_curves_seek_and_follow_the_run_and_the_track(browser):
    names = "[...document.querySelectorAll('.curves figcaption')].map((caption) => caption.textContent)"
    browser.run("seek(0)")
    browser.run(DRAWN)
    error, overlap, sigma = browser.run(names)
    assert error == "Joint error, mean (dashed: raw)17.3 mm"
    assert overlap.startswith("IoU, mean over views0.8")
    assert sigma == "Uncertainty of a joint, mean17.3 mm"
    click(browser, ".curves svg", across=3 / 7)
    assert frame(browser).startswith("Frame 39")
    press(browser, "r")
    browser.run(DRAWN)
    assert browser.run(names)[0] != error
    browser.run("part.run.value = 0; part.run.dispatchEvent(new Event('change'))")
    browser.run(DRAWN)
    assert browser.run(names)[1] != overlap
    assert frame(browser).startswith("Frame 39")


def test_a_camera_is_chosen_by_its_picture(browser):
    click(browser, "#cameras button")
    assert browser.run("state.through") == 0
    left, right = np.array_split(world(browser)[100:-100, 250:-250].astype(int), 2, axis=1)
    assert (left[..., 0] > left[..., 2] + 40).mean() > 0.5  # the mask's left half is orange over the green image
    assert (right[..., 1] > right[..., 0] + 40).mean() > 0.5
    click(browser, "#free")
    assert browser.run("state.through") is None


def test_all_cameras_are_seen_side_by_side_with_the_body_over_them(browser, result):
    """In small pictures at the side always, and large where one asks for it."""
    press(browser, "a")
    browser.run("drawPictures = () => 0; seek(3)")
    shown = world(browser).astype(int)
    assert browser.run(
        "[...part.labels.querySelectorAll('.corner')].map((label) => label.textContent.slice(0, 7))"
    ) == [f"{k + 1} {name}" for k, name in enumerate(result.cameras.names)]
    views = browser.run("views.map(({ left, top, pinhole: { size } }) => [left, top, ...size])")
    assert len(views) == 3
    for left, top, width, height in views:
        cell = shown[top : top + height, left : left + width]
        assert (cell[..., 2] - cell[..., 0] > 40).mean() > 0.01  # the body is blue
    tiles = browser.run(
        """tiles.map(({ bones, button }) => {
            const drawn = bones.getContext("2d").getImageData(0, 0, bones.width, bones.height).data;
            const { top, bottom } = button.getBoundingClientRect();
            return [drawn.some((value) => value > 0), top >= 0 && bottom <= innerHeight];
        })"""
    )
    assert tiles == [[True, True]] * 3
    browser.ask("Input.dispatchMouseEvent", type="mouseMoved", x=400, y=300)
    click(browser, "#world", across=0.25)
    assert browser.run("state.through") == 0
    press(browser, "0")
    assert browser.run("state.through") is None


def test_a_key_shows_and_hides_each_layer(browser):
    press(browser, "1")
    for key, name in {"m": "mask", "b": "mesh", "s": "skeleton", "d": "deviations", "t": "truth", "n": "names"}.items():
        before, was = world(browser), browser.run(f"part.{name}.checked")
        press(browser, key)
        assert browser.run(f"part.{name}.checked") != was
        assert (world(browser) != before).any(), name
        press(browser, key)
        np.testing.assert_array_equal(world(browser), before)


def test_joints_are_pinned_by_clicks_in_two_cameras(browser, result):
    press(browser, "p")
    assert browser.run("[state.through, part.pins.hidden]") == ["all", False]
    browser.run("part.joint.value = 'LWrist'; seek(3)")
    browser.run(DRAWN)
    wrist = result.subject.body.skeleton.joints.index("LWrist")
    for k in (0, 2):
        at = browser.run(
            f"""(() => {{
                const box = part.world.getBoundingClientRect(), {{ pinhole, left, top }} = views[{k}];
                const [x, y] = pinhole.pixel(placeOf(joints, {wrist})), share = box.width / part.world.width;
                return [(x + left) * share + box.left, (y + top) * share + box.top];
            }})()"""
        )
        for kind in ("mousePressed", "mouseReleased"):
            browser.ask("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button="left", clickCount=1)
    browser.run(DRAWN)
    assert browser.run("part.labels.querySelectorAll('.cross').length") == 2
    (pin,) = tomllib.loads(browser.run("part.file.value"))["pin"]
    assert (pin["frame"], pin["joint"]) == (39, "LWrist")
    seen = project(result.cameras, result.joints()[result.best_run, 3])[:, wrist]
    for k in (0, 2):
        np.testing.assert_allclose(pin[result.cameras.names[k]], seen[k], atol=1.5)
    browser.run("part.pinned.querySelector('button').click()")
    assert browser.run("part.file.value") == ""


def test_the_joint_below_the_pointer_is_named(browser, result):
    wrist = result.subject.body.skeleton.joints.index("LWrist")
    at = browser.run(
        f"""(() => {{
            const box = part.world.getBoundingClientRect(), [x, y] = views[0].pinhole.pixel(placeOf(joints, {wrist}));
            return [x + box.left + 2, y + box.top];
        }})()"""
    )
    named = "[...part.labels.querySelectorAll('.joint')].filter((label) => !label.hidden).map((at) => at.textContent)"
    assert browser.run(named) == []
    browser.ask("Input.dispatchMouseEvent", type="mouseMoved", x=at[0], y=at[1])
    browser.run(DRAWN)
    assert browser.run(named) == ["LWrist"]


def test_an_address_names_a_frame(browser, result):
    browser.run("location.hash = '#frame=39'")
    assert frame(browser).startswith("Frame 39")
    press(browser, "ArrowRight")
    browser.run("new Promise((done) => setTimeout(done, 400))")
    assert browser.run("location.hash") == "#frame=42"
    browser.run("location.hash = '#frame=1000'")
    assert frame(browser).startswith("Frame 51")
    browser.run("location.hash = '#elsewhere'")
    assert frame(browser).startswith("Frame 51")


def test_speed_and_view_have_keys(browser):
    press(browser, ",")
    press(browser, ",")
    assert browser.run("part.speed.value") == "0.25"
    for _ in range(9):
        press(browser, ".")
    assert browser.run("part.speed.value") == "2"
    before = browser.run("[orbit.heading, orbit.distance]")
    press(browser, "ArrowLeft", shift=True)
    press(browser, "+")
    press(browser, "v")
    assert browser.run("[orbit.heading, orbit.distance]") == before


def test_who_wants_little_motion_sees_a_clip_once(browser):
    emulate(browser, prefers_reduced_motion="reduce")
    browser.run("seek(last - 1); play(true)")
    browser.run("new Promise((done) => setTimeout(done, 700))")
    assert browser.run("[state.playing, state.position]") == [False, FRAMES - 1]


def test_labels_of_curves_lie_beside_them(browser):
    apart = """[...document.querySelectorAll(".curves .plot")].every((plot) => {
        const curve = plot.querySelector("svg").getBoundingClientRect();
        return [...plot.querySelectorAll("span")].every((label) => label.getBoundingClientRect().right <= curve.left);
    })"""
    assert browser.run(apart)


@pytest.mark.skipif(AXE is None, reason="axe-core is not installed")
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_axe_finds_nothing(browser, width, scheme):
    resize(browser, width, 800)
    emulate(browser, prefers_color_scheme=scheme)
    browser.run("document.querySelector('details').open = true")
    for shown in ("lookThrough(null)", "lookThrough(0)", "lookThrough(ALL)", "pinJoints(true)"):
        browser.run(shown)
        browser.run(DRAWN)
        assert violations(browser) == []


@pytest.mark.skipif(find_firefox() is None, reason="Firefox is not installed")
def test_firefox_shows_it_too(page, tmp_path):
    with Firefox(find_firefox(), tmp_path) as firefox:
        firefox.ask("WebDriver:SetWindowRect", width=1280, height=900)
        firefox.ask("WebDriver:Navigate", url=f"{page.resolve().as_uri()}#frame=39")
        firefox.run(DRAWN)
        assert firefox.run("document.getElementById('trouble').hidden") == firefox.draws
        assert firefox.run("document.getElementById('where').textContent").startswith("Frame 39")
        firefox.press("\ue014a")  # the right arrow, then all cameras
        firefox.run(DRAWN)
        assert firefox.run("document.getElementById('where').textContent").startswith("Frame 42")
        assert firefox.run("document.getElementById('all').ariaPressed") == "true"
        if firefox.draws:
            picture = cv2.imdecode(np.frombuffer(firefox.picture(), np.uint8), cv2.IMREAD_COLOR).astype(int)
            stage = picture[50:500, 20:900]
            assert (stage[..., 0] - stage[..., 2] > 40).mean() > 0.01  # bodies are blue
        assert AXE is None or violations(firefox) == []


def test_a_picture_of_another_frame_says_so(browser):
    """Where images have no room they are of fewer frames than the body."""
    browser.run("content.every.images = 3; seek(4); lookThrough(0)")
    browser.run(DRAWN)
    assert browser.run("[part.age.textContent, tiles[0].age.textContent]") == ["image of frame 39"] * 2
    browser.run("seek(6)")
    browser.run(DRAWN)
    assert browser.run("part.age.textContent") == ""


def test_a_drag_turns_and_a_wheel_comes_nearer(browser):
    before = browser.run("[orbit.heading, orbit.distance]")
    for kind, x, buttons in (("mousePressed", 300, 1), ("mouseMoved", 360, 1), ("mouseReleased", 360, 0)):
        browser.ask("Input.dispatchMouseEvent", type=kind, x=x, y=300, button="left", buttons=buttons, clickCount=1)
    browser.ask("Input.dispatchMouseEvent", type="mouseWheel", x=300, y=300, deltaX=0, deltaY=-120)
    browser.run(DRAWN)
    heading, distance = browser.run("[orbit.heading, orbit.distance]")
    assert heading == pytest.approx(before[0] - 60 / 150)
    assert distance < before[1]


@pytest.mark.parametrize("width", [320, 390, 768, 1280])
def test_nothing_is_wider_than_the_screen(browser, width):
    resize(browser, width, 800)
    browser.run(DRAWN)
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert browser.run("part.world.clientHeight") > 200


def test_dark_has_its_colours(browser):
    light = world(browser)[5, -5]
    emulate(browser, prefers_color_scheme="dark")
    dark = world(browser)[5, -5]
    assert light.tolist() == [241, 243, 245]
    assert dark.tolist() == [29, 33, 39]


def test_it_plays_in_time(browser):
    """At a quarter and at twice the speed, whatever the rate of drawing."""
    later = "setTimeout(() => done(performance.now() - from), 700)"
    taken = f"new Promise((done) => {{ const from = performance.now(); {later}; }})"
    browser.run("seconds.forEach((_, i) => { seconds[i] = 10 * i; })")
    now = "(() => { const i = Math.floor(state.position); return seconds[i] + 10 * (state.position - i); })()"
    for speed in (0.25, 2):
        browser.run(f"part.speed.value = '{speed}'; seek(0); play(true)")
        browser.run(DRAWN)
        start = browser.run(now)
        elapsed = browser.run(taken)
        assert browser.run(now) - start == pytest.approx(speed * elapsed / 1000, rel=0.35)
        browser.run("play(false)")
        browser.run("seek(0)")


def test_without_webgl_pictures_and_curves_work(page, tmp_path):
    with Browser(PROGRAM, tmp_path, "--disable-3d-apis") as browser:
        browser.open(page)
        browser.run(DRAWN)
        assert not browser.run("part.trouble.hidden")
        press(browser, "ArrowRight")
        assert frame(browser).startswith("Frame 33")
        assert browser.told("Runtime.exceptionThrown") == []
