"""Compressed glTF is read as it was before it was compressed; what is damaged is told in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from glb_file import Glb
from made_up_rigs import rewritten, write_creature

from mmocap_warp.errors import InputError
from mmocap_warp.formats.rigged import compressed
from mmocap_warp.formats.rigged.gltf import read_gltf

DRACO, MESHOPT = compressed.DRACO, compressed.MESHOPT


def with_draco(glb: Glb) -> bytes:
    """The only primitive compressed by Draco: positions, and what else there is under numbers from 1."""
    import DracoPy

    document, binary = glb.json, glb.binary
    primitive = document["meshes"][0]["primitives"][0]
    arrays = {name: glb.array(accessor) for name, accessor in primitive["attributes"].items()}
    for accessor in primitive["attributes"].values():
        del document["accessors"][accessor]["bufferView"]
    points, count = arrays.pop("POSITION"), len(next(iter(arrays.values())))
    numbers = {name: k for k, name in enumerate(arrays, 1)}
    face, generic = np.arange(count, dtype=np.uint32).reshape(-1, 3), {numbers[name]: arrays[name] for name in arrays}
    packed = DracoPy.encode(points, face, quantization_bits=24, preserve_order=True, generic_attributes=generic)
    numbers["POSITION"] = max(numbers.values()) + 1
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(packed)})
    document["accessors"].append({"componentType": 5125, "count": count, "type": "SCALAR"})
    primitive["indices"] = len(document["accessors"]) - 1
    about = {"bufferView": len(document["bufferViews"]) - 1, "attributes": numbers}
    primitive["extensions"] = {DRACO: about}
    document["extensionsRequired"] = [DRACO]
    return binary + packed


def test_a_mesh_compressed_by_draco(tmp_path: Path) -> None:
    plain = read_gltf(write_creature(tmp_path / "creature.glb"))
    read = read_gltf(rewritten(tmp_path / "creature.glb", with_draco))
    np.testing.assert_allclose(read.vertex, plain.vertex, atol=1e-6)
    np.testing.assert_array_equal(read.face, plain.face)
    np.testing.assert_array_equal(read.influence, plain.influence)
    np.testing.assert_array_equal(read.weight, plain.weight)


@pytest.mark.parametrize("damage", ["bytes", "number", "count"])
def test_damage_below_draco_is_told_in_one_line(tmp_path: Path, damage: str) -> None:
    def damaged(glb: Glb) -> bytes:
        before, packed, document = len(glb.binary), with_draco(glb), glb.json
        primitive = document["meshes"][0]["primitives"][0]
        if damage == "number":
            primitive["extensions"][DRACO]["attributes"]["POSITION"] = 99
        if damage == "count":
            document["accessors"][primitive["attributes"]["POSITION"]]["count"] -= 1
        return packed[: before + 9] + bytes(len(packed) - before - 9) if damage == "bytes" else packed

    with pytest.raises(InputError, match="is damaged"):
        read_gltf(rewritten(write_creature(tmp_path / "creature.glb"), damaged))


@pytest.mark.parametrize(
    ("extension", "said"),
    [
        (DRACO, "pip install DracoPy"),
        (MESHOPT, "pip install meshoptimizer"),
        ("KHR_gaussian_splatting", "export it again as glTF"),
    ],
)
def test_what_cannot_be_decoded_is_refused_by_name(
    tmp_path: Path, extension: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compressed, "find_spec", lambda name: None)
    file = write_creature(tmp_path / "creature.glb", extensionsRequired=[extension])
    with pytest.raises(InputError, match=f"needs the glTF extension {extension}.*{said}"):
        read_gltf(file)
