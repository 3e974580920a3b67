"""Damage that readers once did not survive, one kind at a time; ``tests/fuzz`` looks for more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration_files import write_easymocap
from synthetic import ring_rig

from mmocap_warp.errors import InputError
from mmocap_warp.formats.calibration.opencv_yaml import read_opencv_yaml
from mmocap_warp.formats.toml_table import Table, load_toml
from mmocap_warp.formats.truth_file import read_truth, write_truth
from mmocap_warp.result.truth import Truth

BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join(9 * [f'*{before}'])}]\n" for before, name in zip("abcdefg", "bcdefgh", strict=True)
)
MATRIX = "K_a: !!opencv-matrix\n  rows: {rows}\n  cols: 3\n  dt: d\n  data: [ 600, 0, 320, 0, 600, 240, 0, 0, 1 ]\n"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a = " + 3000 * "[" + 3000 * "]", "deep"),
        (".".join(3000 * "a") + " = 1", "deep"),
        ("a = " + 5000 * "9", "more digits"),
    ],
)
def test_toml_beyond_all_bounds(tmp_path, text, problem):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError, match=problem):
        load_toml(tmp_path / "a.toml")


def test_a_key_where_none_is_known_is_to_be_taken_out():
    with pytest.raises(InputError, match="unknown key 'a'; take it out"):
        Table({"a": 1}, "scene.toml", "").finish()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (BOMB, "contains an alias"),
        ("a: " + 3000 * "[" + 3000 * "]", "deep"),
        ('names: ["a"]\n' + MATRIX.format(rows=2**31), "K_a is not a matrix of 9 numbers"),
        ("names: a\n", "names is not a list"),
        (2**20 * "# a comment\n", "over 1 MB"),
    ],
)
def test_opencv_yaml_beyond_all_bounds(tmp_path, text, problem):
    for name in ("intri.yml", "extri.yml"):
        (tmp_path / name).write_text("%YAML:1.0\n---\n" + text)
    with pytest.raises(InputError, match=problem):
        read_opencv_yaml(tmp_path)


def test_opencvs_own_files_give_the_same_bits(tmp_path):
    """As OpenCV writes them: long matrices in several lines, single precision, numbers without decimals."""
    distortion = np.random.default_rng(0).normal(0, 1e-6, (3, 5)).astype(np.float32)
    rig = replace(ring_rig(3, (640, 480)), distortion=distortion)
    write_easymocap(tmp_path, rig)
    intrinsics = (tmp_path / "intri.yml").read_text()
    (tmp_path / "intri.yml").write_text(intrinsics.replace("H_cam01: 480", "H_cam01: 480."))
    read = read_opencv_yaml(tmp_path)
    for name in ("K", "R", "t", "size"):
        np.testing.assert_array_equal(getattr(read, name), getattr(rig, name))
    np.testing.assert_array_equal(read.distortion, distortion.astype(np.float64))


def test_a_truth_with_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "a.usda"
    write_truth(path, Truth(60.0, np.arange(1), ("NAME",), np.zeros((1, 1, 3)), (), np.zeros((1, 0, 3))))
    path.write_bytes(path.read_bytes().replace(b"NAME", b"\xff\xfe"))
    with pytest.raises(InputError, match=r"a\.usda"):
        read_truth(path)


def test_a_line_quotes_no_more_than_can_be_read():
    shown = str(InputError("a.toml", f"a = {10**6 * 'x'} is not a number", "give a number"))
    assert shown.startswith("a.toml: a = xxx")
    assert shown.endswith(" is not a number; give a number")
    assert len(shown) < 500
