"""Plots of measures are pictures of them."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from measured import answer, made_walk
from other_bodies import quadruped

from mmocap_warp.biomechanics.measure_all import measure
from mmocap_warp.display.result_plots import plot_angles, plot_feet
from mmocap_warp.errors import InputError
from mmocap_warp.rigging.shipped import load_body

SVG = "{http://www.w3.org/2000/svg}"
MAN = load_body("adult_man")


@pytest.fixture(scope="module")
def walk():
    return measure(answer(MAN, made_walk(MAN, cycles=1.2, fps=60.0)[0]))


def curves(path):
    """Path data by the class of the group that each curve is in."""
    found = {}
    for group in ElementTree.parse(path).getroot().iter(f"{SVG}g"):
        for each in group.iter(f"{SVG}path"):
            found.setdefault(group.get("class"), []).append(each.get("d"))
    return found


def test_a_panel_for_each_angle_with_left_and_right(walk, tmp_path):
    plot_angles(tmp_path / "angles.svg", walk)
    drawn = curves(tmp_path / "angles.svg")
    assert (len(drawn["left"]), len(drawn["right"])) == (18, 18)
    assert len(drawn["middle"]) == 6  # of two joints
    words = "".join(ElementTree.parse(tmp_path / "angles.svg").getroot().itertext())
    assert "Knee: internal rotation [°]" in words
    assert "Trunk: bending to the right [°]" in words


def test_bars_are_where_a_foot_stands(walk, tmp_path):
    plot_feet(tmp_path / "feet.svg", walk)
    drawn = curves(tmp_path / "feet.svg")
    for side in ("left", "right"):
        foot = walk.shown.feet[side]
        track, *bars = drawn[side]
        assert len(bars) == len(foot.strikes) + foot.on_floor[0]
        first = float(re.match(r"M([\d.]+)", bars[-1])[1])
        begin = foot.strikes[-1] if len(foot.strikes) else 0
        assert first == pytest.approx(46 + 900 * begin / (len(foot.height) - 1), abs=0.1)
        assert track.startswith("M46 ")


@pytest.mark.parametrize("frames", [1, 2])
def test_short_clips_and_unknown_angles_are_drawn(tmp_path, frames):
    poses = np.zeros((frames, MAN.skeleton.coordinates))
    measures = measure(answer(MAN, poses))
    measures.shown.angles["LShoulder"]["plane_of_elevation"][:] = np.nan
    measures.shown.angles["RShoulder"]["plane_of_elevation"][:] = np.nan
    plot_angles(tmp_path / "angles.svg", measures)
    plot_feet(tmp_path / "feet.svg", measures)
    assert "nan" not in (tmp_path / "angles.svg").read_text() + (tmp_path / "feet.svg").read_text()


def test_of_a_long_clip_some_frames_are_drawn(tmp_path):
    measures = measure(answer(MAN, np.zeros((2500, MAN.skeleton.coordinates))))
    plot_feet(tmp_path / "feet.svg", measures)
    track, bar = curves(tmp_path / "feet.svg")["left"]
    assert track.count("l") == 834  # every third
    assert bar.endswith("L946 " + bar.rsplit(" ", 1)[1])


def test_a_dogs_left_and_right_are_in_one_panel(tmp_path):
    measures = measure(answer(quadruped(), np.zeros((4, quadruped().skeleton.coordinates))))
    plot_angles(tmp_path / "angles.svg", measures)
    drawn = curves(tmp_path / "angles.svg")
    assert (len(drawn["left"]), len(drawn["right"])) == (6, 6)  # three angles of each leg
    assert len(drawn["middle"]) == 1  # head
    plot_feet(tmp_path / "feet.svg", measures)
    drawn = curves(tmp_path / "feet.svg")
    assert (len(drawn["left"]), len(drawn["right"])) == (4, 4)  # a track and a bar for each foot
    words = "".join(ElementTree.parse(tmp_path / "angles.svg").getroot().itertext())
    assert "ForeKnee: x [°]" in words


def test_a_folder_that_is_not_there(walk, tmp_path):
    with pytest.raises(InputError, match="folder does not exist"):
        plot_feet(tmp_path / "none" / "feet.svg", walk)
