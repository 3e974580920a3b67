"""glTF whose buffer views meshopt compressed is read as it was before; collected where the package is there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshoptimizer
import numpy as np
import pytest
from glb_file import Glb
from made_up_rigs import rewritten, write_creature

from mmocap_warp.errors import InputError
from mmocap_warp.formats.rigged.compressed import MESHOPT, meshopt_view
from mmocap_warp.formats.rigged.gltf import read_gltf


def with_meshopt(glb: Glb) -> bytes:
    """Every buffer view compressed; their buffer is a fallback that is not there."""
    packed, document = b"", glb.json
    for accessor, about in enumerate(document["accessors"]):
        view, values = document["bufferViews"][about["bufferView"]], glb.array(accessor).view(np.uint8)
        stride = values.shape[1]
        part = meshoptimizer.encode_vertex_buffer(np.ascontiguousarray(values), len(values), stride)
        place = {"buffer": 0, "byteOffset": len(packed), "byteLength": len(part)}
        how = {"byteStride": stride, "count": len(values), "mode": "ATTRIBUTES"}
        view |= {"buffer": 1, "extensions": {MESHOPT: place | how}}
        packed += part
    document["buffers"] = [{"byteLength": len(packed)}, {"byteLength": len(glb.binary)}]
    document["extensionsRequired"] = [MESHOPT]
    return packed


def test_buffer_views_compressed_by_meshopt(tmp_path: Path) -> None:
    plain = read_gltf(write_creature(tmp_path / "creature.glb"))
    read = read_gltf(rewritten(tmp_path / "creature.glb", with_meshopt))
    for name in ("vertex", "face", "influence", "weight", "bind"):
        np.testing.assert_array_equal(getattr(read, name), getattr(plain, name), err_msg=name)
    np.testing.assert_array_equal(read.motions["Nod"].world, plain.motions["Nod"].world)


@pytest.mark.parametrize("stride", [2, 4])
def test_triangles(stride: int) -> None:
    face = np.array([0, 1, 2, 2, 1, 3, 4, 5, 6], np.uint32)
    about = {"count": 9, "byteStride": stride, "mode": "TRIANGLES"}
    data = meshopt_view(about, meshoptimizer.encode_index_buffer(face, 9, 7))
    found = np.frombuffer(data, {2: "<u2", 4: "<u4"}[stride]).reshape(-1, 3)
    turned = {tuple(np.roll(each, k)) for each in face.reshape(-1, 3) for k in range(3)}
    assert {tuple(each) for each in found} <= turned
    assert len(found) == 3


def test_turns_that_were_filtered() -> None:
    """Of a quaternion's largest part only the place is kept, in the last two bits of the fourth number."""
    stored = np.array([[0, 0, 0, 32764 | 3], [23169, 0, 0, 32764 | 3]], np.int16)
    about = {"count": 2, "byteStride": 8, "mode": "ATTRIBUTES", "filter": "QUATERNION"}
    data = meshopt_view(about, meshoptimizer.encode_vertex_buffer(stored, 2, 8))
    turns = np.frombuffer(data, "<i2").reshape(2, 4) / 32767
    np.testing.assert_allclose(turns, [[0, 0, 0, 1], [0.5, 0, 0, np.sqrt(0.75)]], atol=1e-3)


@pytest.mark.parametrize(
    "about",
    [
        {"count": 4, "byteStride": 6, "mode": "ATTRIBUTES"},
        {"count": 0, "byteStride": 4, "mode": "ATTRIBUTES"},
        {"count": 1 << 27, "byteStride": 4, "mode": "ATTRIBUTES"},
        {"count": 4, "byteStride": 4, "mode": "TRIANGLES"},
        {"count": 4, "byteStride": 12, "mode": "ATTRIBUTES", "filter": "QUATERNION"},
        {"count": 4, "byteStride": 4, "mode": "ATTRIBUTES"},
    ],
)
def test_what_would_be_written_elsewhere_or_is_damaged_is_refused(about: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"a buffer view of|meshopt"):
        meshopt_view(about, b"\xa0\x00\x00")


def test_damage_below_meshopt_is_told_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is damaged"):
        read_gltf(rewritten(write_creature(tmp_path / "c.glb"), lambda glb: with_meshopt(glb)[:-40] + bytes(40)))
