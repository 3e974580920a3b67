"""Functions that write scenes, bodies and studies: what they give, and wrong arguments in Python's words."""

from __future__ import annotations

import pytest

import mmocap_warp as mm
from mmocap_warp.rigging.shipped import body_file


def test_a_folder_without_videos_is_no_scene(tmp_path):
    with pytest.raises(mm.InputError, match="holds no video and no folder of images"):
        mm.init(tmp_path)
    with pytest.raises(mm.InputError, match="no such folder"):
        mm.init(tmp_path / "none")


def test_a_body_is_drawn_and_exported_by_name_or_file(tmp_path):
    shown = mm.show_body("hand", tmp_path / "hand.png")
    exported = mm.export_body(body_file("hand"), tmp_path / "hand.glb")
    assert shown.file.is_file()
    assert exported.file.is_file()
    assert repr(exported) == f"{tmp_path / 'hand.glb'}: {len(shown.body.skeleton.joints)} joints, " + (
        f"{len(shown.motions)} motions"
    )
    assert mm.validate_usd(body_file("hand")) == []


def test_limits_are_learnt_from_motions(tmp_path):
    learnt = mm.learn_body("hand", tmp_path / "hand.usdc", margin=0.0)
    assert learnt.frames == sum(len(motion.pose) for motion in learnt.motions.values())
    assert mm.load_body(tmp_path / "hand.usdc").skeleton.limits == pytest.approx(learnt.body.skeleton.limits, abs=1e-6)
    with pytest.raises(mm.UsageError, match=r"^margin must be from 0 to 180 degrees, got 200"):
        mm.learn_body("hand", tmp_path / "other.usdc", margin=200)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda folder: mm.synthesize("hand", folder / "a", cameras=0), r"^cameras and size must be at least 1, got 0"),
        (lambda folder: mm.make_sequences(folder / "a", ["S9/Fly"]), r"^sequence S9/Fly is not one of S1/Walking"),
        (lambda folder: mm.make_sequences(folder / "a", degrade="worse"), r"^degrade: "),
        (lambda folder: mm.make_sequences(folder / "a", ["S1/Box"], frames=2, degrade="views=9"), r"^degrade: views"),
        (lambda folder: mm.make_sequences(folder / "a", ["S1/Box"], seed=-1), r"^seed must be at least 0, got -1"),
        (lambda folder: mm.synthesize("hand", folder / "a", seed=-1), r"^seed must be at least 0, got -1"),
        (lambda folder: mm.run_study("none.toml", engine="cloud"), r"none.toml"),
        (lambda folder: mm.benchmark(threads=0), r"^threads must be at least 1"),
        (
            lambda folder: mm.report_study(folder, folder / "page.html"),
            r"holds no result; run 'mmocap study run' first",
        ),
    ],
)
def test_wrong_arguments_are_named_and_leave_nothing(call, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        call(tmp_path)
    assert list(tmp_path.iterdir()) == []
