"""A Rerun recording, read back with Rerun's own reader."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rerun_file import write_rerun
from shown import Recording, made_result

from mmocap_warp.body.posing import Poser
from mmocap_warp.cameras.rig import UP_AXES
from mmocap_warp.result.truth import Truth


def read(path):
    """Per entity, the frames (None for what does not change) and values of its components."""
    from rerun.chunk import RrdReader

    entities = {}
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        frames = None if chunk.is_static else batch.column("frame").to_pylist()
        for name in batch.schema.names:
            if ":" in name:
                values = batch.column(name).to_pylist()
                entities.setdefault(chunk.entity_path, {})[name] = (frames, values)
    return entities


def test_every_frame_of_the_best_run_is_read_back(tmp_path):
    result = made_result()
    body, run = result.subject.body, result.best_run
    truth = Truth(
        result.fps, result.frame_numbers, (), np.zeros((6, 0, 3)), body.skeleton.joints, result.joints()[run] + 0.01
    )
    write_rerun(tmp_path / "r.rrd", result, Recording(result), truth)
    entities = read(tmp_path / "r.rrd")
    numbers = result.frame_numbers.tolist()
    frames, vertices = entities["/world/skin"]["Mesh3D:vertex_positions"]
    assert frames == numbers
    posed = Poser(body, result.subject.root_base).tracking_vertices(result.pose[run])
    np.testing.assert_array_equal(np.array(vertices, np.float32), posed)
    _, (triangles,) = entities["/world/skin"]["Mesh3D:triangle_indices"]
    np.testing.assert_array_equal(triangles, body.tracking_face)
    for track, pose in (("final", result.pose), ("raw", result.raw_pose)):
        frames, strips = entities[f"/world/skeleton/{track}"]["LineStrips3D:strips"]
        assert frames == numbers
        joints = replace(result, pose=pose).joints()[run]
        lines = joints[:, [[parent, j] for j, parent in enumerate(body.skeleton.parent) if parent >= 0]]
        np.testing.assert_allclose(np.array(strips), lines, atol=1e-6)
    camera = entities["/world/cam02"]
    K = np.array(camera["Pinhole:image_from_camera"][1][0]).reshape(3, 3).T
    np.testing.assert_allclose(K[:2, 2], result.cameras.K[1, :2, 2] + 0.5, rtol=1e-6)
    _, masks = entities["/world/cam02/mask"]["EncodedImage:blob"]
    mask = cv2.imdecode(np.frombuffer(bytes(np.ravel(masks[0]).astype(np.uint8)), np.uint8), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(mask > 0, np.broadcast_to(np.arange(320) < 160, (240, 320)))
    (error,) = [of for name, of in entities.items() if "Joint" in name and name.endswith("/final")]
    np.testing.assert_allclose(np.ravel(error["Scalars:scalars"][1]), 10 * np.sqrt(3), rtol=1e-6)


@pytest.mark.parametrize("up", UP_AXES)
def test_every_vertical_has_a_name(tmp_path, up):
    result = made_result(frames=2)
    write_rerun(tmp_path / "r.rrd", replace(result, cameras=replace(result.cameras, up=up)))
    ((_, (axes,)),) = read(tmp_path / "r.rrd")["/world"].values()
    assert len(np.ravel(axes)) == 3
