from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd

from mmocap_warp.errors import InputError
from mmocap_warp.formats.truth_file import load_truth, read_truth, write_truth
from mmocap_warp.formats.usd.usd_check import faults
from mmocap_warp.result.truth import Truth, at_rate

SINGLE_PRECISION = 1e-6  # [m], at a few metres
TURN = np.array([[0.8, 0.0, 0.6], [0.6, 0.0, -0.8], [0.0, 1.0, 0.0]])


def some_truth(pose=True):
    rng = np.random.default_rng(0)
    markers, joints = rng.normal(0, 1, (5, 3, 3)), rng.normal(0, 1, (5, 2, 3))
    markers[1, 2] = markers[4] = np.nan
    return Truth(
        fps=60.0,
        frame_numbers=np.array([3, 4, 5, 8, 9]),
        marker_names=("HEAD", "LWRI", "R ANK"),
        markers=markers,
        joint_names=("LWrist", "RAnkle"),
        joints=joints,
        pose=rng.normal(0, 1, (5, 51)) if pose else None,
        root_base=TURN if pose else None,
    )


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
@pytest.mark.parametrize("pose", [True, False])
def test_truth_reads_back(tmp_path, suffix, pose):
    truth, path = some_truth(pose), tmp_path / f"truth.{suffix}"
    write_truth(path, truth, up="-y")
    again = load_truth(path)
    assert (again.fps, again.marker_names, again.joint_names) == (60.0, truth.marker_names, truth.joint_names)
    np.testing.assert_array_equal(again.frame_numbers, truth.frame_numbers)
    np.testing.assert_allclose(again.markers, truth.markers, rtol=0, atol=SINGLE_PRECISION)
    np.testing.assert_allclose(again.joints, truth.joints, rtol=0, atol=SINGLE_PRECISION)
    if pose:
        np.testing.assert_array_equal(again.pose, truth.pose)
        np.testing.assert_array_equal(again.root_base, TURN)
    else:
        assert again.pose is again.root_base is None
    assert faults(path) == []


def test_axes_of_usd_are_the_worlds(tmp_path):
    write_truth(tmp_path / "truth.usdc", some_truth())
    for wrong in ({"axes": "zxy"}, {"first_frame": 1}):
        with pytest.raises(InputError, match=r"cannot have axes = '.*' or a first_frame; leave both out"):
            load_truth(tmp_path / "truth.usdc", **wrong)


def test_truth_without_markers_or_joints_reads_back(tmp_path):
    truth = some_truth()
    bare = replace(truth, marker_names=(), markers=np.zeros((5, 0, 3)), joint_names=(), joints=np.zeros((5, 0, 3)))
    write_truth(tmp_path / "truth.usdc", bare)
    again = read_truth(tmp_path / "truth.usdc")
    assert again.markers.shape == again.joints.shape == (5, 0, 3)


def test_arrays_that_disagree_are_refused():
    truth = some_truth()
    with pytest.raises(ValueError, match="joints must be"):
        replace(truth, joints=truth.joints[:-1])
    with pytest.raises(ValueError, match=r"root_base must be \(3, 3\)"):
        replace(truth, root_base=TURN[:2])
    with pytest.raises(ValueError, match="must ascend"):
        replace(truth, frame_numbers=truth.frame_numbers[::-1])


def without_prim(layer):
    del layer.pseudoRoot.nameChildren["Truth"]


def with_version(layer):
    layer.GetAttributeAtPath("/Truth.mmocap:truthVersion").default = 99


def one_frame_less(layer):
    layer.EraseTimeSample(Sdf.Path("/Truth/Markers.points"), 8.0)


def a_stray_id(layer):
    layer.SetTimeSample(Sdf.Path("/Truth/Joints.ids"), 4.0, [0, 7])


def a_longer_frame_list(layer):
    layer.GetAttributeAtPath("/Truth.mmocap:frames").default = [3, 4, 5, 8, 9, 10]


def frames_out_of_order(layer):
    layer.GetAttributeAtPath("/Truth.mmocap:frames").default = [3, 4, 5, 9, 8]


def a_mirror(layer):
    layer.GetAttributeAtPath("/Truth.mmocap:rootBase").default = Gf.Matrix3d(-1.0)


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (without_prim, "holds no truth"),
        (with_version, "version 99, this program reads 1"),
        (one_frame_less, "/Truth/Markers: attribute points has no value at frame 8"),
        (a_stray_id, "/Truth/Joints: ids do not fit points and names at frame 4"),
        (a_longer_frame_list, "no value at frame 10"),
        (frames_out_of_order, "frame_numbers must ascend"),
        (a_mirror, "mmocap:rootBase is not a rotation"),
    ],
)
def test_wrong_truth_is_one_clear_line(tmp_path, spoil, problem):
    path = tmp_path / "truth.usda"
    write_truth(path, some_truth())
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    spoil(layer)
    layer.Export(str(path))
    with pytest.raises(InputError, match=problem) as caught:
        load_truth(path)
    assert caught.value.source == str(path)
    assert "\n" not in str(caught.value)


def test_a_missing_or_foreign_file_is_named(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_truth(tmp_path / "truth.usdc")
    with pytest.raises(InputError, match=r"has the ending '\.csv', which no truth has"):
        load_truth(tmp_path / "truth.csv")
    Usd.Stage.CreateNew(str(tmp_path / "other.usda")).Save()
    with pytest.raises(InputError, match="holds no truth"):
        load_truth(tmp_path / "other.usda")


def test_joints_of_a_trc_are_numbered_from_the_first_frame(shared_data):
    truth = load_truth(shared_data / "pose2sim_single/reference/bal_filt.trc", axes="zxy", first_frame=-2)
    assert (truth.fps, len(truth.frame_numbers), truth.frame_numbers[0]) == (60.0, 100, -2)
    head = truth.joints[:, truth.joint_names.index("Head")]
    assert 1.5 < np.median(head[:, 2]) < 1.9  # z is up


def moving_truth(fps, numbers):
    """A marker and two joints that move evenly, 60 mm a second; the pose counts the truth's own frames."""
    numbers = np.array(numbers)
    place = (0.06 * numbers / fps)[:, None, None]
    pose = np.tile(numbers[:, None], 51).astype(float)
    return Truth(fps, numbers, ("A",), place + np.zeros((1, 1, 3)), ("B", "C"), place + np.ones((1, 2, 3)), pose, TURN)


def test_a_multiple_of_the_rate_is_picked_not_interpolated():
    truth = moving_truth(240.0, range(8, 30))
    picked = at_rate(truth, 60.0)
    assert picked.fps == 60.0
    assert picked.frame_numbers.tolist() == [2, 3, 4, 5, 6, 7]
    np.testing.assert_array_equal(picked.markers, truth.markers[::4])
    np.testing.assert_array_equal(picked.joints, truth.joints[::4])
    np.testing.assert_array_equal(picked.pose, truth.pose[::4])
    np.testing.assert_array_equal(picked.root_base, TURN)


def test_between_its_frames_a_faster_truth_is_on_the_straight_line():
    truth = moving_truth(100.0, [*range(3, 20), *range(25, 31)])
    truth.joints[2, 1] = np.nan  # frame 5
    slower = at_rate(truth, 60.0)
    assert slower.frame_numbers.tolist() == [2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 15, 16, 17, 18]  # none across the gap
    np.testing.assert_allclose(slower.markers[:, 0, 0], 0.001 * slower.frame_numbers, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(np.isnan(slower.joints[:, 1, 0]), slower.frame_numbers == 3)
    assert slower.pose is None


def test_rates_that_go_by_one_name_are_one():
    truth = moving_truth(59.94, range(9))
    assert at_rate(truth, 60.0) is truth


def test_a_slower_truth_is_refused():
    with pytest.raises(
        InputError, match="truth: has 50 frames a second, and the recording 60; give a truth of at least"
    ):
        at_rate(moving_truth(50.0, range(9)), 60.0)
