import base64
import json
import re
from dataclasses import replace
from html import unescape

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shown import Recording, made_result
from synthetic import ring_rig

from mmocap_warp.display.chart import COLOURS, picture
from mmocap_warp.display.overlay import LEFT_COLOUR, MASK_COLOUR, MODEL_COLOUR, RIGHT_COLOUR
from mmocap_warp.display.page import page_content
from mmocap_warp.display.page.page_content import Pictures, pose_step
from mmocap_warp.display.page.viewer import view
from mmocap_warp.errors import InputError
from mmocap_warp.result.truth import Truth


def content_of(page):
    """The data that a page holds."""
    (data,) = re.findall(r'<script type="application/json" id="content">(.*?)</script>', page.html, re.S)
    return json.loads(data)


def unpacked(packed, *shape):
    return np.frombuffer(base64.b64decode(packed["data"]), "<" + packed["kind"]).reshape(*shape)


def moved(content, run, track):
    """Joints (frame, joint, 3) and skin (frame, vertex, 3) as the page's shader has them."""
    body, motion = content["body"], content["runs"][run]["tracks"][track]
    shape = len(content["frames"]), len(body["joints"])
    turn = Rotation.from_quat(unpacked(motion["turn"], -1, 4) / 32767.0).as_matrix().reshape(*shape, 3, 3)
    place = motion["place"]["low"] + motion["place"]["step"] * unpacked(motion["place"]["values"], *shape, 3)
    influence, weight = unpacked(body["influence"], -1, 4), unpacked(body["weight"], -1, 4).astype(float)
    rest, vertex = unpacked(body["rest"], -1, 3), unpacked(body["vertex"], -1, 3)
    from_joint = vertex[:, None] - rest[influence]  # (vertex, slot, 3)
    each = np.einsum("fvsij,vsj->fvsi", turn[:, influence], from_joint) + place[:, influence]
    return place, np.einsum("vs,fvsi->fvi", weight / weight.sum(axis=1, keepdims=True), each)


def test_a_page_moves_the_body_as_the_result_does():
    result = made_result()
    content = content_of(view(result))
    assert content["frames"] == result.frame_numbers.tolist()
    assert content["best"] == result.best_run == 1
    for run in range(2):
        for track, pose in (("final", result.pose), ("raw", result.raw_pose)):
            other = replace(result, pose=pose)
            joints, skin = moved(content, run, track)
            np.testing.assert_allclose(joints, other.joints()[run], rtol=0, atol=5e-5)
            np.testing.assert_allclose(skin, other.vertices(run), rtol=0, atol=2e-4)


def test_a_page_has_the_results_triangles_cameras_and_numbers():
    result = made_result()
    content = content_of(view(result))
    body = result.subject.body
    triangles = unpacked(content["body"]["triangle"], -1, 3)
    quads = body.skin.face
    assert {frozenset(triangle) for triangle in triangles.tolist()} == {
        frozenset(face) for quad in quads.tolist() for face in (quad[:3], [quad[0], *quad[2:]])
    }
    coarse = unpacked(content["body"]["coarse"], -1, 3)
    np.testing.assert_array_equal(body.skin.rest[coarse], body.tracking.rest[body.tracking_face])
    for k, camera in enumerate(content["cameras"]):
        assert camera["name"] == result.cameras.names[k]
        for name in ("K", "R", "t", "size"):
            np.testing.assert_array_equal(camera[name], getattr(result.cameras, name)[k])
        assert camera["masks"] == camera["images"] == []
    for run, shown in enumerate(content["runs"]):
        np.testing.assert_array_equal(unpacked(shown["iou"], 6, 3), result.iou[run].astype(np.float32))
        assert shown["status"] == result.status[run].tolist()
        assert shown["name"] == f"run {run}, seed {7 + run}"
        overlap, sigma = shown["curves"]
        with np.errstate(invalid="ignore"):
            np.testing.assert_allclose(
                unpacked(overlap["values"]["final"], 6)[:-1], np.nanmean(result.iou[run, :-1], axis=1), rtol=1e-6
            )
        assert np.isnan(unpacked(overlap["values"]["final"], 6)[-1])
        np.testing.assert_allclose(unpacked(sigma["values"]["final"], 6), 10.0 * np.sqrt(3), rtol=1e-6)


def test_errors_are_those_of_each_track():
    result = made_result()
    names = result.subject.body.skeleton.joints
    known = result.joints()[1]
    truth = Truth(result.fps, result.frame_numbers, (), np.zeros((6, 0, 3)), names, known)
    error = content_of(view(result, truth=truth))["runs"][1]["curves"][0]
    assert (error["name"], error["unit"]) == ("Joint error, mean", "mm")
    np.testing.assert_allclose(unpacked(error["values"]["final"], 6), 0.0, atol=1e-6)
    assert (unpacked(error["values"]["raw"], 6) > 10).all()


def test_a_page_has_what_is_true_and_how_sure_it_is():
    """Of joints that the truth lacks, a bone goes to the next above; what is not known at a frame is marked so."""
    result = made_result()
    skeleton = result.subject.body.skeleton
    names = ("LWrist", "LShoulder", "elsewhere")
    places = result.joints()[1][:, [skeleton.joints.index(name) for name in names[:2]] + [0]]
    places[2, 0] = np.nan
    known = result.frame_numbers[1:]
    truth = Truth(result.fps, known, (), np.zeros((5, 0, 3)), names, places[1:])
    content = content_of(view(result, truth=truth))
    assert content["truth"]["names"] == list(names)
    assert content["truth"]["bones"] == [[0, 1]]
    points = content["truth"]["points"]
    values = unpacked(points["values"], 6, 3, 3)
    assert (values[0] == 65535).all()
    assert (values[2, 0] == 65535).all()
    shown = points["low"] + points["step"] * values
    np.testing.assert_allclose(shown[3:], places[3:], atol=5e-5)
    assert set(unpacked(content["runs"][0]["sigma"], -1).tolist()) == {100}  # tenths of a millimetre
    assert content_of(view(replace(result, joint_sigma=None)))["runs"][0]["sigma"] is None


def test_one_colour_means_one_thing_in_videos_pages_and_plots(tmp_path):
    page = view(made_result(frames=2)).html
    for name, colour in {
        "left": LEFT_COLOUR,
        "right": RIGHT_COLOUR,
        "mask": MASK_COLOUR,
        "model": MODEL_COLOUR,
    }.items():
        light, dark = COLOURS[name]
        assert "#{:02x}{:02x}{:02x}".format(*colour[::-1]) == dark
        assert f"--{name}:{light};" in page
        assert content_of(view(made_result(frames=2)))["colours"][name] == [light, dark]
        plot = picture((10, 10), "", [])
        assert f"--{name}:{light};" in plot
        assert f"--{name}:{dark};" in plot


def test_masks_and_images_are_small_pictures():
    result = made_result(frames=4)
    done = []
    content = content_of(view(result, Recording(result), images=True, progress=lambda *of: done.append(of)))
    assert done == [(1, 4), (2, 4), (3, 4), (4, 4)]
    first, second, _ = content["cameras"]
    masks = [cv2.imdecode(np.frombuffer(base64.b64decode(png), np.uint8), -1) for png in first["masks"]]
    assert [mask.shape for mask in masks] == [(180, 240)] * 4
    np.testing.assert_array_equal(masks[0], np.where(np.arange(240) < 120, 255, 0)[None].repeat(180, axis=0))
    (*_, image) = [cv2.imdecode(np.frombuffer(base64.b64decode(jpeg), np.uint8), -1) for jpeg in first["images"]]
    assert image.shape == (240, 320, 3)
    np.testing.assert_allclose(image.reshape(-1, 3).mean(axis=0), (10, 200, 40), atol=3)
    assert second["images"] == [None] * 4


def test_what_names_hold_is_no_markup():
    result = made_result(frames=2)
    bad = "</script><script>alert(1)</script>&<!--"
    rig = replace(result.cameras, names=(bad, "b", "c"))
    page = view(replace(result, cameras=rig, config={"algorithm": "<b>", "seed": 0}), name=bad)
    assert page.html.count("<script") == 2
    assert "<!--" not in page.html
    assert "<b>" not in page.html
    assert content_of(page)["cameras"][0]["name"] == bad
    (title,) = re.findall("<title>(.*)</title>", page.html)
    assert unescape(title) == bad


def test_a_page_asks_for_nothing_from_elsewhere():
    page = view(made_result(frames=2)).html
    assert not re.findall(r"""(?:src|href)=["'](?!data:)""", page)
    assert re.findall(r"https?://[^\"'\s<]+", page) == ["http://www.w3.org/2000/svg"]  # a name, not an address
    assert "default-src 'none'" in page


def test_300_frames_of_four_cameras_are_below_5_megabytes():
    result = made_result(300, cameras=4)
    page = view(replace(result, cameras=ring_rig(4, size=(320, 240))), Recording(result), images=True)
    assert len(page.html.encode()) < 5e6
    assert "poses of every frame (59.9 a second), masks of every frame, images of every frame." in page.html


def test_pictures_that_have_no_room_are_left_out_evenly():
    each = ["a" * 100, None, "b" * 100, "c" * 100, "d" * 100]
    assert Pictures.within(800, [each, each]) == Pictures([each, each], 1)
    assert Pictures.within(799, [each, each]) == Pictures([each[::2]] * 2, 2)
    assert Pictures.within(200, [each, each]).of == [["a" * 100, "d" * 100]] * 2


def test_ten_minutes_are_thinned_and_say_so():
    result = made_result(2, cameras=4)
    frames = 36000

    def long(array):
        return np.broadcast_to(array[:1, :1], (1, frames, *array.shape[2:]))

    arrays = ("pose", "raw_pose", "cost", "iou", "evaluations", "status", "joint_sigma")
    ten_minutes = replace(
        result, frame_numbers=np.arange(frames), fps=60.0, **{name: long(getattr(result, name)) for name in arrays}
    )
    step = pose_step(ten_minutes)
    assert 60 / step >= 5
    page = view(ten_minutes)
    assert len(page.html.encode()) < 5e6
    content = content_of(page)
    assert content["frames"] == list(range(0, frames, step))
    assert f"poses of one frame in {step}" in page.html
    assert len(content["runs"][0]["status"]) == len(content["frames"])


def test_what_is_thinned_is_read_at_the_frames_that_are_left(monkeypatch):
    result = made_result(8)
    monkeypatch.setattr(page_content, "_POSE_BYTES", 8 * 4 * 16 * 14 // 3 + 1)  # two tracks of two runs, 16 joints
    scene = Recording(result)
    asked = []
    monkeypatch.setattr(Recording, "of_frames", lambda self, frames: asked.append(frames) or self)
    scene.frames = range(3)
    content = content_of(view(result, scene, images=True))
    assert asked == [range(10, 18, 3)] * 2
    assert content["frames"] == [10, 13, 16]
    assert [len(camera["masks"]) for camera in content["cameras"]] == [3, 3, 3]
    joints, _ = moved(content, 0, "final")
    np.testing.assert_allclose(joints, result.joints()[0, ::3], rtol=0, atol=5e-5)


def test_a_notebook_shows_the_page_in_a_frame():
    page = view(made_result(frames=2))
    (inside,) = re.findall(r'<iframe srcdoc="([^"]*)"', page._repr_html_())
    assert unescape(inside) == page.html


def test_a_scene_of_other_cameras_is_refused(tmp_path):
    result = made_result(frames=2)
    other = Recording(replace(result, cameras=ring_rig(2), iou=result.iou[..., :2]))
    with pytest.raises(InputError, match="has the cameras"):
        view(result, other)
    with pytest.raises(InputError, match="folder does not exist"):
        view(result).write(tmp_path / "nowhere" / "page.html")
