from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from synthetic import ring_rig, synthetic_result

from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import project
from mmocap_warp.cameras.silhouette import silhouette, silhouettes
from mmocap_warp.commands.show import _people, _with_people
from mmocap_warp.display import overlay as overlay_file
from mmocap_warp.display.overlay import (
    ELLIPSE,
    INK,
    LEFT_COLOUR,
    MASK_COLOUR,
    MODEL_COLOUR,
    PAPER,
    RIGHT_COLOUR,
    SIGMA_COLOUR,
    Look,
    ViewedBody,
    Window,
    draw_view,
    write_text,
)
from mmocap_warp.display.result_video import Layout, overlay, show, show_subject, video_layout
from mmocap_warp.errors import InputError, UsageError
from mmocap_warp.masks.mask_settings import ForegroundSettings
from mmocap_warp.scene.mask_writing import TINTS


def small_result(frames=4, cameras=3):
    rig = ring_rig(cameras, size=(160, 120))
    return replace(synthetic_result(frames, runs=1, cameras=cameras), cameras=rig)


def masks_of(result):
    """Per frame and camera, the tracked body's own silhouette."""
    subject = result.subject
    posed = Poser(subject.body, subject.root_base).tracking_vertices(result.pose[0])
    return [silhouettes(result.cameras, vertices, subject.body.tracking_face) for vertices in posed]


def frames_of(path):
    video = cv2.VideoCapture(str(path))
    frames = []
    while (read := video.read())[0]:
        frames.append(read[1])
    return frames, video.get(cv2.CAP_PROP_FPS)


def test_video_and_sheet_show_every_camera(tmp_path, capfd):
    result = small_result()
    show(result, None, masks_of(result), video=tmp_path / "overlay.webm", sheet=tmp_path / "sheet.png")
    frames, fps = frames_of(tmp_path / "overlay.webm")
    assert len(frames) == 4
    assert fps == pytest.approx(result.fps, abs=0.1)
    assert frames[0].shape[0] % 2 == frames[0].shape[1] % 2 == 0
    assert frames[0].shape[1] > frames[0].shape[0]  # three landscape views fill a wide picture in two rows
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet.shape[0] == 30 + 3 * (260 + 4)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["overlay.webm", "sheet.png"]
    assert "OpenCV" not in capfd.readouterr().err


def test_images_go_below_the_drawing(tmp_path):
    result = small_result(frames=1, cameras=1)
    images = [[np.full((480, 640, 3), (10, 200, 10), np.uint8)]]  # four times the cameras' resolution
    show(result, images, None, video=tmp_path / "overlay.webm")
    (frame,), _ = frames_of(tmp_path / "overlay.webm")
    corner = frame[-30:-10, 30:60].reshape(-1, 3).mean(axis=0)
    np.testing.assert_allclose(corner, (10, 200, 10), rtol=0, atol=12)  # the codec is lossy


def test_a_legend_is_as_sharp_in_the_last_frame_as_in_the_first(tmp_path):
    """Over a room with a camera's noise: where bits run short, it is text and outlines that blur."""
    result = replace(synthetic_result(24, runs=1, cameras=2), cameras=ring_rig(2, size=(160, 120)))
    random = np.random.default_rng(0)
    room = cv2.resize(random.integers(40, 220, (60, 80, 3), np.uint8), (320, 240), interpolation=cv2.INTER_CUBIC) // 2
    images = ([room + random.integers(0, 33, room.shape, np.uint8)] * 2 for _ in range(24))
    layout = Layout([Window((0, 0), (160, 120), (320, 240))] * 2, columns=2)
    show(result, images, None, video=tmp_path / "overlay.webm", layout=layout)
    legends = [cv2.cvtColor(frame[:30, -230:], cv2.COLOR_BGR2GRAY) for frame in frames_of(tmp_path / "overlay.webm")[0]]
    sharpness = [cv2.Laplacian(legend, cv2.CV_64F).var() for legend in legends]
    assert min(sharpness) >= 0.9 * sharpness[0]


def test_a_video_is_cut_to_where_the_body_is_over_the_clip():
    result = small_result()
    body, (width, height) = Poser(result.subject.body, result.subject.root_base), (160, 120)
    layout = video_layout(result)
    for k, window in enumerate(layout.windows):
        seen = np.concatenate([project(result.cameras, body.tracking_vertices(pose)[0])[k] for pose in result.pose[0]])
        low, high = np.maximum(seen.min(axis=0), 0), np.minimum(seen.max(axis=0), (width - 1, height - 1))
        assert (np.array(window.corner) <= low).all()
        assert (np.add(window.corner, window.extent) >= high).all()
        assert window.extent[0] * window.extent[1] < width * height
        assert window.size[0] / window.size[1] == pytest.approx(window.extent[0] / window.extent[1], rel=0.01)
    assert {window.extent for window in video_layout(result, whole=True).windows} == {(160, 120)}


@pytest.mark.parametrize("cameras", [1, 2, 5, 11])
@pytest.mark.parametrize("size", [(160, 120), (120, 160), (400, 60)])
def test_a_video_has_no_more_pixels_than_a_screen(tmp_path, cameras, size):
    result = replace(synthetic_result(1, runs=1, cameras=cameras), cameras=ring_rig(cameras, size=size))
    for whole in (False, True):
        show(result, None, None, video=tmp_path / "o.webm", layout=video_layout(result, whole), deviations=True)
        ((frame,), _) = frames_of(tmp_path / "o.webm")
        assert 600 <= frame.shape[1] <= 1920
        assert frame.shape[0] <= 1080


def test_people_have_colours_and_names_of_their_own(tmp_path, monkeypatch):
    first = replace(small_result(frames=2, cameras=2), joint_sigma=None)
    second = replace(first, pose=first.pose + np.r_[0.5, np.zeros(first.pose.shape[-1] - 1)])
    written, write = [], overlay_file.write_text

    def told(canvas, text, *rest):
        written.append(text)
        return write(canvas, text, *rest)

    monkeypatch.setattr(overlay_file, "write_text", told)
    looks = [Look("anna", (31, 210, 255)), Look("ben", (80, 200, 60))]
    files = {"video": tmp_path / "o.webm", "sheet": tmp_path / "o.png", "strip": tmp_path / "o.webp"}
    people = [(look, each, masks_of(each)) for look, each in zip(looks, (first, second), strict=True)]
    show(first, None, None, people=people, **files)
    sheet, (_, strip) = cv2.imread(str(files["sheet"])), cv2.imreadanimation(str(files["strip"]))
    for picture in (sheet, strip.frames[0][..., :3]):
        for colour in (looks[0].colour, looks[1].colour, INK):
            assert (np.abs(picture.astype(int) - colour).max(axis=2) < 60).any()
    for colour in (LEFT_COLOUR, RIGHT_COLOUR, MODEL_COLOUR):  # of one who is alone
        assert not (sheet == colour).all(axis=2).any()
    assert {text.split()[0] for text in written} == {"anna", "ben"}
    assert {"anna", "ben"} < set(written)  # without numbers in the strip
    assert f"ben {second.iou[0, 0, 1]:.3f}" in written
    # The video shows all of both.
    alone, both = (video_layout(first, others=others).windows[0].extent for others in ([], [second]))
    assert both[0] * both[1] > alone[0] * alone[1]


def test_colours_are_those_of_the_masks_overlay():
    """A person's by the place in the scene, as masks are tinted, whoever is shown first; else in turn."""
    scene, tracked = SimpleNamespace(people={"anna": None, "ben": None}), small_result(1)
    ben, anna = (replace(tracked, config={**tracked.config, "person": name}) for name in ("ben", "anna"))
    assert [look for look, *_ in _people([(ben, scene), (anna, scene)])] == [
        Look("ben", TINTS[1]),
        Look("anna", TINTS[0]),
    ]
    assert _people([(tracked, None)] * 6)[5][0] == Look("person6", TINTS[0])
    assert _people([(ben, scene)]) == []
    assert [look.name for look, *_ in _people([(ben, scene), (ben, scene)])] == ["ben", "person2"]
    assert _with_people(ben, "other.usdc") == [ben, "other.usdc"]


def test_who_is_nearer_is_drawn_over_the_other_and_no_name_over_another():
    result = small_result(frames=1, cameras=1)
    poser = Poser(result.subject.body, result.subject.root_base)
    (pixels,) = project(result.cameras, poser.tracking_vertices(result.pose[0])[0])
    (joints,) = project(result.cameras, poser.joint_transforms(result.pose[0])[0][:, :3, 3])
    window = Window((0, 0), (160, 120), (640, 480))
    near, far = (
        ViewedBody(result.subject.body, None, pixels, joints, None, Look(name, colour), depth)
        for name, colour, depth in (("near", (31, 210, 255), 1.0), ("far", (80, 200, 60), 2.0))
    )
    views = [draw_view(window, (160, 120), None, bodies) for bodies in ([near, far], [far, near])]
    np.testing.assert_array_equal(*views)
    x, y = np.rint(window.points(joints[1:2])[0]).astype(int)
    np.testing.assert_allclose(views[0][y, x], near.look.colour, atol=20)
    above = views[0][: int(window.points(pixels)[:, 1].min()) + 20].astype(int)
    for look in (near.look, far.look):
        assert (np.abs(above - look.colour).max(axis=2) < 20).any()


def test_a_slow_video_and_an_animated_strip(tmp_path):
    result = small_result(frames=8, cameras=2)
    show(result, None, None, video=tmp_path / "o.webm", strip=tmp_path / "o.webp", slow=4.0)
    assert frames_of(tmp_path / "o.webm")[1] == pytest.approx(result.rate / 4, abs=0.1)
    _, strip = cv2.imreadanimation(str(tmp_path / "o.webp"))
    assert len(strip.frames) == 8
    assert sum(strip.durations) == pytest.approx(4000 * 8 / result.rate, rel=0.02)
    assert strip.loop_count == 0  # without end
    assert strip.frames[0].shape[0] <= 240
    assert strip.frames[0].shape[1] <= 960
    assert (tmp_path / "o.webp").stat().st_size < 200_000


def test_ellipses_are_drawn_when_they_are_asked_for(tmp_path):
    result = small_result(frames=1, cameras=1)
    wide = replace(result, joint_sigma=np.full((1, 1, len(result.subject.body.skeleton.joints), 3), 0.01))
    for name, deviations in (("without", False), ("with", True)):
        show(wide, None, None, sheet=tmp_path / f"{name}.png", deviations=deviations)
    without, drawn = (cv2.imread(str(tmp_path / f"{name}.png")).astype(int) for name in ("without", "with"))
    assert not (np.abs(without - SIGMA_COLOUR).max(axis=2) < 20).any()
    assert (np.abs(drawn - SIGMA_COLOUR).max(axis=2) < 20).any()


def test_lost_views_and_cameras_without_images_are_drawn(tmp_path):
    result = small_result()
    nothing = np.full_like(result.iou, np.nan)
    lost = replace(result, iou=nothing, cost=np.full_like(result.cost, np.nan), status=np.full((1, 4), 2, np.int8))
    show(lost, [[None] * 3] * 4, [[np.zeros((120, 160), bool)] * 3] * 4, sheet=tmp_path / "sheet.png")
    assert (tmp_path / "sheet.png").is_file()


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"video": "nowhere/overlay.webm"}, "folder does not exist"),
        ({"sheet": "nowhere/sheet.png"}, "its folder does not exist"),
    ],
)
def test_a_wrong_place_is_refused(tmp_path, arguments, problem):
    with pytest.raises(InputError, match=problem):
        show(small_result(), None, None, **{kind: tmp_path / name for kind, name in arguments.items()})
    assert list(tmp_path.iterdir()) == []


def test_a_recording_that_is_too_short_leaves_nothing_behind(tmp_path):
    result = small_result()
    with pytest.raises(InputError, match="has no frame 12, which the result has"):
        show(result, None, masks_of(result)[:2], video=tmp_path / "overlay.webm", sheet=tmp_path / "sheet.png")
    assert list(tmp_path.iterdir()) == []


def test_a_window_maps_pixels_as_it_maps_the_picture():
    """A bright pixel lands where its centre is said to land, at twice the size and at half."""
    image = np.zeros((60, 80), np.uint8)
    image[30:34, 40:44] = 255
    for size in ((80, 80), (20, 20)):
        window = Window((20, 10), (40, 40), size)
        picture = window.picture(image, (80, 60), cv2.INTER_AREA)
        rows, columns = np.nonzero(picture > 127)
        centre = window.points(np.array([[41.5, 31.5]]))[0]
        np.testing.assert_allclose([columns.mean(), rows.mean()], centre, rtol=0, atol=1e-9)


def test_a_view_shows_skin_contours_and_skeleton():
    result = small_result(frames=1, cameras=1)
    rig = ring_rig(1, size=(640, 480))
    subject = result.subject
    poser = Poser(subject.body, subject.root_base)
    vertices = project(rig, poser.tracking_vertices(subject.pose)[0])[0]
    joints = project(rig, poser.joint_transforms(subject.pose)[0, :, :3, 3])[0]
    faces = subject.body.tracking_face
    model = silhouette(vertices, faces, (640, 480)) > 0
    mask = np.roll(model, 40, axis=1)
    window = Window((0, 0), (640, 480), (640, 480))
    body = ViewedBody(subject.body, mask, vertices, joints)
    view = draw_view(window, (640, 480), None, [body]).astype(int)

    def drawn(colour, tolerance=40):
        return np.abs(view - colour).max(axis=2) < tolerance

    edge = model & ~cv2.erode(model.astype(np.uint8), np.ones((3, 3))).astype(bool)
    assert drawn(MODEL_COLOUR)[edge].mean() > 0.6
    mask_edge = mask & ~cv2.erode(mask.astype(np.uint8), np.ones((3, 3))).astype(bool)
    assert drawn(MASK_COLOUR)[mask_edge].mean() > 0.5
    for joint, colour in ((5, LEFT_COLOUR), (8, RIGHT_COLOUR)):
        x, y = np.rint(joints[joint]).astype(int)
        assert drawn(colour)[y, x]
    assert (
        view[~model & ~mask & ~cv2.dilate((model | mask).astype(np.uint8), np.ones((5, 5))).astype(bool)] == PAPER
    ).all()


def test_a_joint_that_is_unsure_has_a_wide_ellipse():
    result = small_result(frames=1, cameras=1)
    sigma = np.zeros((1, 1, len(result.subject.body.skeleton.joints), 3))
    sigma[0, 0, 0] = np.nan
    sure = overlay(replace(result, joint_sigma=sigma))
    joint = result.subject.body.skeleton.joints.index("LWrist")
    sigma[0, 0, joint, 1] = 0.2 / ELLIPSE  # up and down
    unsure = overlay(replace(result, joint_sigma=sigma))
    rows, columns = np.nonzero((sure != unsure).any(axis=2))
    (place,) = project(result.cameras, result.joints()[0, 0, joint][None])[0]
    low, high = (
        project(result.cameras, (result.joints()[0, 0, joint] + off)[None])[0, 0] for off in ([0, -0.2, 0], [0, 0.2, 0])
    )
    assert rows.max() - rows.min() == pytest.approx(abs(high[1] - low[1]), abs=3)
    assert columns.max() - columns.min() < 6
    assert (rows.max() + rows.min()) / 2 == pytest.approx(place[1], abs=2)


def test_an_ellipse_that_is_smaller_than_a_joints_dot_is_seen():
    result = replace(small_result(frames=1, cameras=1), cameras=ring_rig(1, size=(640, 480)))
    sigma = np.full((1, 1, len(result.subject.body.skeleton.joints), 3), 0.006 / ELLIPSE)
    with_ellipses, without = (
        np.abs(overlay(each)[:, :, ::-1].astype(int) - SIGMA_COLOUR).sum(axis=2)
        for each in (replace(result, joint_sigma=sigma), result)
    )
    for x, y in np.rint(project(result.cameras, result.joints()[0, 0])[0]).astype(int):
        around = slice(y - 2, y + 3), slice(x - 2, x + 3)
        assert with_ellipses[around].min() < without[around].min() - 50


def test_a_subjects_picture_has_rows_of_a_length_and_says_how_tall_a_fit_is(tmp_path):
    result = small_result(frames=1, cameras=5)
    fitted = replace(result.subject, provenance={"body.height": 1.7, "body.height.sigma": 0.01})
    drawn = []
    for name, subject in (("given", result.subject), ("fitted", fitted)):
        show_subject(subject, tmp_path / f"{name}.png", result.cameras)
        drawn.append(cv2.imread(str(tmp_path / f"{name}.png")))
    height, width = drawn[0].shape[:2]
    second = drawn[0][height // 2 :]  # two of five, below three
    assert (np.abs(second[:, width // 3 : 2 * width // 3].astype(int) - MODEL_COLOUR).max(axis=2) < 60).any()
    assert (second[:, 2 * width // 3 + 10 :] == PAPER).all()
    changed = np.nonzero((drawn[0] != drawn[1]).any(axis=2))[0]
    assert len(changed)
    assert changed.max() < 30


def test_a_picture_tells_the_length_of_what_is_measured_by_it(tmp_path, monkeypatch):
    result, titles = small_result(frames=1), []
    monkeypatch.setattr(
        "mmocap_warp.display.result_video.write_text", lambda canvas, text, *_, **__: titles.append(text)
    )
    size = {"body.height": 0.79, "body.height.sigma": 0.01, "body.length": 1.55, "body.length.sigma": 0.02}
    show_subject(replace(result.subject, provenance=size), tmp_path / "fox.png", result.cameras)
    assert titles[-1].endswith("1.55 +- 0.02 m long")


def test_text_may_touch_the_border():
    canvas = np.zeros((20, 60, 3), np.uint8)
    assert write_text(canvas, "far too long a line", (0, 0)) > 60
    assert canvas.max() > 150


class Recording:
    """What an overlay asks of a scene: green images twice the cameras' size, and masks that are full."""

    recorded_frames, path, foreground = 20, "scene.toml", ForegroundSettings()

    def __init__(self, result):
        self.calibrated = result.cameras
        self.asked = []

    def of_frames(self, frames):
        self.asked.append(frames)
        return self

    def images(self, scale=1.0):
        self.asked.append(("images", scale))
        yield [np.full((240, 320, 3), (10, 200, 40), np.uint8)] * len(self.calibrated)

    def masks(self, scale, body):
        self.asked.append(("masks", scale))
        yield [np.ones((120, 160), bool)] * len(self.calibrated)


def test_an_overlay_is_one_cameras_picture_in_red_green_blue():
    result = replace(synthetic_result(frames=4), cameras=ring_rig(3, size=(160, 120)), config={"scale": 0.5})
    alone = overlay(result, frame=2, camera=1)
    assert (alone.shape, alone.dtype) == ((120, 160, 3), np.uint8)
    assert tuple(alone[0, 0]) == PAPER[::-1]
    left, right = project(result.cameras, result.joints()[result.best_run, 2, [5, 8]])[1].round().astype(int)  # wrists
    assert alone[left[1], left[0]].argmax() == 1  # green
    assert alone[right[1], right[0]].argmax() == 0  # red
    np.testing.assert_array_equal(alone, overlay(result, None, -2, result.cameras.names[1], run=result.best_run))
    assert (alone != overlay(result, frame=2, camera=1, run=1 - result.best_run)).any()

    scene = Recording(result)
    drawn = overlay(result, scene, 2, 1)
    number = result.frame_numbers[2]
    this = range(number, number + 1)
    assert scene.asked == [this, ("images", 1.0), this, ("masks", 0.5)]
    assert drawn.shape == (240, 320, 3)
    np.testing.assert_array_equal(drawn[20, 20], (40, 200, 10))


@pytest.mark.parametrize("camera", [3, -1, "cam9"])
def test_an_overlay_of_no_camera(camera):
    with pytest.raises(UsageError, match=r"camera must be one of .* got"):
        overlay(small_result(), camera=camera)
