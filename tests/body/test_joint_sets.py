"""Joint sets: tables of weighted skin vertices and joints, and where their points are in poses."""

import io
import pickle
import sys
import zipfile
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from xml.etree import ElementTree

import anny_weights
import numpy as np
import pytest

from mmocap_warp.body import joint_sets
from mmocap_warp.body.joint_sets import joint_set, parse_joint_set
from mmocap_warp.body.model import Subject
from mmocap_warp.body.posing import joint_positions, skin_positions
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import read_body, write_body
from mmocap_warp.rigging.shipped import load_body

SETS = {"isb": 15, "coco17": 17, "body25": 25, "h36m17": 17, "humaneva": 15, "soma77": 22, "rajagopal": 41}
MAN = load_body("adult_man")
DOCS = Path(__file__).parents[2] / "docs"
POSE = np.random.default_rng(0).uniform(-0.5, 0.5, (3, MAN.skeleton.coordinates))
SUBJECT = Subject(MAN, np.eye(3), POSE[0], {})


def test_the_rigs_own_set_is_the_rig() -> None:
    rig = joint_set("rig", MAN)
    assert rig.names == MAN.skeleton.joints
    np.testing.assert_allclose(rig.positions(SUBJECT, POSE), joint_positions(SUBJECT, POSE), atol=1e-6)


@pytest.mark.parametrize(("name", "points"), SETS.items())
@pytest.mark.parametrize("person", ["adult_man", "adult_woman", "tall_slim_adult"])
def test_named_sets_lie_near_the_joints_that_they_define_otherwise(person: str, name: str, points: int) -> None:
    body = load_body(person)
    each = joint_set(name, body)
    rest = each.at_rest(body)
    assert len(each.names) == points
    known = each.counterpart >= 0
    away = np.linalg.norm(rest[known] - body.joint_rest[each.counterpart[known]], axis=1)
    assert away.max() < 0.12
    # Left and right mirror each other within a vertex's distance.
    joints = [body.skeleton.joints[number] if number >= 0 else "" for number in each.counterpart]
    for left, place in zip(joints, rest, strict=True):
        if left.startswith("L"):
            np.testing.assert_allclose(rest[joints.index(f"R{left[1:]}")], place * [-1, 1, 1], atol=2e-3)


PLUGIN_GAIT = (
    "LFHD RFHD LBHD RBHD C7 T10 CLAV STRN RBAK LSHO RSHO LUPA RUPA LELB RELB LFRM RFRM LWRA RWRA LWRB RWRB LFIN RFIN "
    "LASI RASI LPSI RPSI LTHI RTHI LKNE RKNE LTIB RTIB LANK RANK LHEE RHEE LTOE RTOE"
)


def test_all_markers_of_plug_in_gait_and_all_that_opensim_is_set_up_for_are_there() -> None:
    model = joint_set("rajagopal", MAN)
    named = set(PLUGIN_GAIT.split())
    assert len(named) == 39
    assert named <= {*model.names, *MAN.marker_names}
    # The setups name each marker but the one that the model does not have, in tasks of either tool and in pairs.
    for setup in (DOCS / "interchange" / "opensim").glob("*.xml"):
        root = ElementTree.parse(setup).getroot()
        assert {task.get("name") for task in root.iter("IKMarkerTask")} == {*model.names} - {"RBAK"}
        assert {name for pair in root.iter("markers") for name in pair.text.split()} <= {*model.names}


def test_points_follow_the_fitted_shape_and_scale() -> None:
    each = joint_set("isb", MAN)
    larger = MAN.shaped({"hip_width_incr": 1.0}, 1.1)
    hips = [each.at_rest(body)[each.names.index("LHip"), 0] for body in (MAN, larger)]
    assert hips[1] > 1.1 * hips[0]


def test_a_point_is_carried_by_a_joint_or_follows_the_skin() -> None:
    text = "vertices = 13380\n[landmarks]\nA = [1000, 1001]\n[joints]\nsoft = { of = { A = 0.5, v20 = 0.5 } }\n"
    text += 'hard = { on = "LHip", is = "LKnee", of = { LKnee = 1 } }\nroot = { is = "Root" }'
    own = parse_joint_set(text, MAN, "own")
    places, joints = own.positions(SUBJECT, POSE), joint_positions(SUBJECT, POSE)
    skin = skin_positions(SUBJECT, POSE, np.array([1000, 1001, 20]))
    np.testing.assert_allclose(places[:, 0], skin.transpose(0, 2, 1) @ [0.25, 0.25, 0.5], atol=1e-6)
    np.testing.assert_allclose(places[:, 1:], joints[:, [MAN.skeleton.index("LKnee"), 0]], atol=1e-6)
    assert own.axes(MAN).tolist()[1:] == [MAN.skeleton.index("LHip"), 0]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("x", "not valid TOML"),
        ("[landmarks]\nA = 1", "no joints"),
        ("vertices = 5\n[joints]\na = { is = 'Root' }", "5 vertices"),
        ("[landmarks]\nA = 99999\n[joints]\na = { is = 'Root' }", "'A' is no vertex"),
        ("[joints]\na = { of = { Nowhere = 1 } }", "names 'Nowhere'"),
        ("[joints]\na = { of = { Root = 0.5 } }", "sum to 0.5"),
        ("[joints]\na = { of = { Root = 'x' } }", "a number"),
        (f"[joints]\na = {{ of = {{ Root = 1{400 * '0'} }} }}", "a number"),
        (f"[joints]\na = {{ of = {{ v{5000 * '1'} = 1 }} }}", "names 'v111"),
        ("[joints]\na = 1", "is no table"),
        ("landmarks = 1\n[joints]\na = { is = 'Root' }", "landmarks is no table"),
    ],
)
def test_a_wrong_table_is_refused(text: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        parse_joint_set(text, MAN, "own.toml")


def test_sets_come_by_file_with_the_body_or_not_at_all(tmp_path) -> None:
    text = "[joints]\nmiddle = { of = { LHip = 0.5, RHip = 0.5 } }\n"
    (tmp_path / "own.toml").write_text(text)
    write_body(tmp_path / "man.usdc", replace(MAN, joint_sets={"mine": text}))
    carried = read_body(tmp_path / "man.usdc")
    for each in (joint_set(str(tmp_path / "own.toml"), MAN), joint_set("mine", carried)):
        assert each.names == ("middle",)
        assert each.name in ("own", "mine")
    assert joint_set("isb", MAN).name == "isb"
    with pytest.raises(InputError, match="there is no 'mine'"):
        joint_set("mine", MAN)
    with pytest.raises(InputError, match="13380 vertices"):
        joint_set("isb", load_body("fox"))


def saved_tensor(weight: np.ndarray, extra: object = None) -> bytes:
    """What ``torch.save`` writes of a dictionary with one tensor, and perhaps another object."""
    module = ModuleType("torch._utils")

    def _rebuild_tensor_v2(*_: object) -> None: ...

    _rebuild_tensor_v2.__module__, _rebuild_tensor_v2.__qualname__ = module.__name__, "_rebuild_tensor_v2"
    module._rebuild_tensor_v2 = _rebuild_tensor_v2

    class Storage: ...

    class Tensor:
        def __reduce__(self) -> tuple:
            return _rebuild_tensor_v2, (Storage(), 0, weight.shape, (1,), False, OrderedDict())

    class Pickler(pickle.Pickler):
        def persistent_id(self, each: object) -> object:
            return ("storage", FloatStorage, "0", "cpu", len(weight)) if isinstance(each, Storage) else None

    class FloatStorage: ...

    FloatStorage.__module__, FloatStorage.__qualname__ = module.__name__, "FloatStorage"
    module.FloatStorage = FloatStorage
    data, archive = io.BytesIO(), io.BytesIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "torch", ModuleType("torch"))
        patch.setitem(sys.modules, module.__name__, module)
        Pickler(data).dump({"left_hip": Tensor(), **({} if extra is None else {"extra": extra})})
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("coco/data.pkl", data.getvalue())
        file.writestr("coco/data/0", weight.astype("<f4").tobytes())
    return archive.getvalue()


def test_weights_of_an_installed_anny_are_read_without_torch(tmp_path, monkeypatch) -> None:
    file = tmp_path / "data" / "keypoints" / "coco.pth"
    file.parent.mkdir(parents=True)
    weight = np.zeros(13500)
    weight[[10, 20]] = 0.25, 0.75
    found = SimpleNamespace(submodule_search_locations=[str(tmp_path)])
    monkeypatch.setattr(anny_weights, "find_spec", lambda name: found)
    file.write_bytes(saved_tensor(weight))
    (tmp_path / "coco-anny.toml").write_text(anny_weights.table(MAN))
    each = joint_set(tmp_path / "coco-anny.toml", MAN)
    assert each.names == ("left_hip",)
    assert each.counterpart.tolist() == [MAN.skeleton.joints.index("LHip")]
    np.testing.assert_allclose(each.at_rest(MAN)[0], MAN.skin.rest[[10, 20]].T @ [0.25, 0.75], atol=1e-6)
    file.write_bytes(saved_tensor(weight, io.StringIO))  # nothing of a file is run but what makes tensors
    with pytest.raises(InputError, match="cannot be read"):
        anny_weights.anny_weights()
    monkeypatch.setattr(anny_weights, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="not installed"):
        anny_weights.anny_weights()


def test_the_shipped_tables_are_those_that_an_error_names() -> None:
    with pytest.raises(InputError) as caught:
        joint_set("none", MAN)
    assert set(SETS) <= {file.stem for file in joint_sets._FOLDER.glob("*.toml")}
    assert all(name in str(caught.value) for name in SETS)
