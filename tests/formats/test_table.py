"""The table of formats: every line leads to a function, and an ending to one format."""

from __future__ import annotations

import inspect
import subprocess
import sys
from itertools import combinations
from pathlib import Path

import pytest

from mmocap_warp.errors import InputError
from mmocap_warp.formats.table import CALIBRATION_EXPORTS, CALIBRATIONS, EXPORTS, Format, export, read_calibration


@pytest.mark.parametrize("format", CALIBRATIONS, ids=str)
def test_readers_are_called_alike(format: Format) -> None:
    assert list(inspect.signature(format.load()).parameters) == list(inspect.signature(read_calibration).parameters)


@pytest.mark.parametrize("format", EXPORTS, ids=str)
def test_writers_are_called_alike(format: Format) -> None:
    taken = list(inspect.signature(export).parameters)
    assert list(inspect.signature(format.load()).parameters) == taken[:2] + ["joint_set"] * format.takes_joint_set


@pytest.mark.parametrize("formats", [CALIBRATIONS, EXPORTS])
def test_an_ending_names_one_format(formats: tuple[Format, ...]) -> None:
    for one, other in combinations(formats, 2):
        for suffix in one.suffixes:
            assert suffix == suffix.lower()
            assert not other.matches(Path(f"name{suffix}"))


@pytest.mark.parametrize("name", ["other.yml", "my_intri.yml", "old_cameras.txt"])
def test_a_format_of_fixed_names_takes_no_other(name: str) -> None:
    assert not any(format.matches(Path(name)) for format in (*CALIBRATIONS, *CALIBRATION_EXPORTS))


def test_the_case_of_an_ending_does_not_matter() -> None:
    assert [format.name for format in CALIBRATIONS if format.matches(Path("Calib.QCA.TXT"))] == ["Qualisys"]


@pytest.mark.parametrize(
    ("name", "problem"), [("rig.xml", "ends in '.xml'"), ("rig", "has no ending"), ("Calib.txt", "ends in '.txt'")]
)
def test_an_unknown_ending_names_the_known_ones(tmp_path: Path, name: str, problem: str) -> None:
    with pytest.raises(InputError) as caught:
        read_calibration(tmp_path / name)
    told = str(caught.value)
    assert told.startswith(f"{tmp_path / name}: {problem}, which is none of the known formats; give Pose2Sim/")
    assert all(str(format) in told for format in CALIBRATIONS)
    assert "\n" not in told


def test_the_table_imports_nothing_heavy() -> None:
    code = "import sys, mmocap_warp.formats.table; print({'warp', 'pxr', 'cv2', 'numpy'} & set(sys.modules))"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "set()"
