"""glTF characters: joints, skin and motions as the file has them; damage is told in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from made_up_rigs import JOINTS, creature_mesh, write_creature

from mmocap_warp.errors import InputError
from mmocap_warp.formats.rigged.gltf import read_gltf


def test_joints_and_skin_are_those_of_the_file(tmp_path: Path) -> None:
    read = read_gltf(write_creature(tmp_path / "creature.glb"))
    assert read.joints == tuple(JOINTS)
    above = [None if parent < 0 else read.joints[parent] for parent in read.parent]
    assert above == [parent for parent, _ in JOINTS.values()]
    np.testing.assert_allclose(read.bind[:, :3, 3], [place for _, place in JOINTS.values()], atol=1e-6)
    vertex, face, influence, weight = creature_mesh()
    np.testing.assert_allclose(read.vertex, vertex, atol=1e-6)
    np.testing.assert_array_equal(read.face, face)
    np.testing.assert_array_equal(read.influence[:, :6], influence)
    np.testing.assert_allclose(read.weight[:, :6], weight, atol=1e-6)
    assert read.attribution == "Made up for tests."


def test_an_animation_turns_its_joint_and_what_hangs_on_it(tmp_path: Path) -> None:
    read = read_gltf(write_creature(tmp_path / "creature.glb"))
    nod = read.motions["Nod"]
    assert nod.fps == 60
    assert len(nod.world) == 31
    head, end, hips = (read.joints.index(name) for name in ("head", "head end", "hips"))
    np.testing.assert_allclose(nod.world[:, hips], np.tile(read.bind[hips], (31, 1, 1)), atol=1e-6)
    angle = np.radians(30.0) * np.arange(31) / 30
    np.testing.assert_allclose(np.arctan2(nod.world[:, head, 2, 1], nod.world[:, head, 1, 1]), angle, atol=1e-5)
    expected = read.bind[head, :3, 3] + 0.2 * np.stack([0 * angle, np.cos(angle), np.sin(angle)], axis=1)
    np.testing.assert_allclose(nod.world[:, end, :3, 3], expected, atol=1e-6)


def test_a_skin_bound_in_another_space_is_brought_to_the_scenes(tmp_path: Path) -> None:
    """Exporters bind in the mesh's own space; here it is a hundred times larger and lies elsewhere."""
    plain = read_gltf(write_creature(tmp_path / "plain.glb"))
    data = write_creature(tmp_path / "other.glb", scale=100.0).read_bytes()
    size = int.from_bytes(data[12:16], "little")
    nodes = json.loads(data[20 : 20 + size])["nodes"]
    for node in nodes[:-1]:
        node["translation"] = (np.array(node["translation"]) / 100).tolist()
    nodes[-1]["scale"] = [0.01, 0.01, 0.01]
    read = read_gltf(write_creature(tmp_path / "other.glb", scale=100.0, nodes=nodes))
    np.testing.assert_allclose(read.vertex, plain.vertex, atol=1e-5)
    np.testing.assert_allclose(read.bind[:, :3, 3], plain.bind[:, :3, 3], atol=1e-5)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"skins": []}, "damaged"),
        ({"nodes": [{"name": "nothing"}]}, "holds no skinned mesh"),
        ({"extensionsRequired": ["KHR_gaussian_splatting"]}, "KHR_gaussian_splatting"),
        ({"buffers": [{"byteLength": 9, "uri": "../secret.bin"}]}, "which is outside"),
        ({"buffers": [{"byteLength": 9, "uri": "/etc/passwd"}]}, "which is outside"),
        ({"buffers": [{"byteLength": 9, "uri": "absent.bin"}]}, "which is not in"),
        ({"buffers": []}, "damaged"),
        ({"accessors": 7}, "damaged"),
    ],
)
def test_what_cannot_be_read_is_told_in_one_line(tmp_path: Path, changes: dict, said: str) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "secret.bin").write_bytes(b"x" * 99)
    with pytest.raises(InputError, match=said) as told:
        read_gltf(write_creature(tmp_path / "in" / "creature.glb", **changes))
    assert "\n" not in str(told.value)


def test_a_skin_without_weights_or_with_too_few_joints_is_told(tmp_path: Path) -> None:
    data = write_creature(tmp_path / "whole.glb").read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    meshes, skins = document["meshes"], document["skins"]
    for number in range(2):
        del meshes[0]["primitives"][0]["attributes"][f"JOINTS_{number}"]
    with pytest.raises(InputError, match="a mesh with a skin needs JOINTS_0 and WEIGHTS_0"):
        read_gltf(write_creature(tmp_path / "bare.glb", meshes=meshes))
    skins[0] = {"joints": skins[0]["joints"][:3]}
    with pytest.raises(InputError, match=r"a vertex follows joint \d of a skin that has 3"):
        read_gltf(write_creature(tmp_path / "few.glb", skins=skins))


def test_damage_never_ends_in_another_error(tmp_path: Path) -> None:
    whole = write_creature(tmp_path / "creature.glb").read_bytes()
    rng = np.random.default_rng(0)
    for trial in range(150):
        data = bytearray(whole[: rng.integers(len(whole))] if trial % 3 == 0 else whole)
        for place in rng.integers(max(len(data), 1), size=4 if len(data) else 0):
            data[place] = rng.integers(256)
        (tmp_path / "damaged.glb").write_bytes(data)
        try:
            read_gltf(tmp_path / "damaged.glb")
        except InputError:
            continue


def test_a_joint_without_skin_and_bind_transform_is_bound_beside_its_neighbour(tmp_path: Path) -> None:
    file = write_creature(tmp_path / "creature.glb")
    plain, data = read_gltf(file), file.read_bytes()
    end = plain.joints.index("head end")
    inverse, none = (
        matrix.T.astype(np.float32).tobytes() for matrix in (np.linalg.inv(plain.bind[end].round(3)), np.eye(4))
    )
    assert data.count(inverse) == 1
    file.write_bytes(data.replace(inverse, none))
    np.testing.assert_allclose(read_gltf(file).bind, plain.bind, atol=1e-6)


def test_of_keys_at_one_time_the_last_counts(tmp_path: Path) -> None:
    file = write_creature(tmp_path / "creature.glb")
    data, time = file.read_bytes(), np.array([0.0, 0.5], np.float32)
    assert data.count(time.tobytes()) == 1
    file.write_bytes(data.replace(time.tobytes(), np.full(2, 0.5, np.float32).tobytes()))
    nod = read_gltf(file)
    turned = nod.motions["Nod"].world[:, nod.joints.index("head"), 2, 1]
    np.testing.assert_allclose(turned, np.sin(np.radians(30)), atol=1e-6)


@pytest.mark.parametrize(("last", "frames"), [(0.5, 31), (1e6, 58), (np.inf, 0), (np.nan, 0), (-1.0, 0)])
def test_of_a_long_animation_the_beginning_is_taken(
    tmp_path: Path, last: float, frames: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    nodes = 11
    monkeypatch.setattr("mmocap_warp.formats.rigged.gltf._MAX_TRANSFORMS", 57 * nodes)
    file = write_creature(tmp_path / "creature.glb")
    data, time = file.read_bytes(), np.array([0.0, 0.5], np.float32)
    file.write_bytes(data.replace(time.tobytes(), np.array([0.0, last], np.float32).tobytes()))
    read = read_gltf(file)
    assert [len(motion.world) for motion in read.motions.values()] == ([frames] if frames else [])
    assert len([note for note in read.notes if "lasts" in note]) == (frames != 31)


def test_parts_without_a_skin_that_never_move_by_themselves_are_no_joints(tmp_path: Path) -> None:
    file = write_creature(tmp_path / "plain.glb")
    size = int.from_bytes(file.read_bytes()[12:16], "little")
    document = json.loads(file.read_bytes()[20 : 20 + size])
    mesh, (nod,) = {"mesh": 0}, document["animations"]
    nodes = [{"name": "body", "children": [1, 2]}, {"name": "cube"} | mesh, {"name": "leg", "children": [3]} | mesh]
    moved = [{"sampler": 0, "target": {"node": node, "path": "rotation"}} for node in (0, 2)]
    toy = read_gltf(
        write_creature(
            tmp_path / "toy.glb",
            nodes=[*nodes, {"name": "cube", "translation": [0, 1, 0]} | mesh],
            skins=[],
            scenes=[{"nodes": [0]}],
            animations=[nod | {"channels": moved}],
        )
    )
    assert toy.joints == ("body", "leg")
    assert toy.notes == ("mesh cube has no skin: it follows body", "mesh cube has no skin: it follows leg")
    assert len(toy.vertex) == 3 * len(creature_mesh()[0])
