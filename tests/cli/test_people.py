"""Two people from label images to a result each and a picture of both."""

import json

import pytest

from mmocap_warp.cli import main
from mmocap_warp.formats.usd.usd_people import results_in
from mmocap_warp.formats.usd.usd_result import read_result

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("people") / "two"
    flags = ["--sequence", "S1/Walking", "--sequence", "S2/Walking", "--together", "--frames", "4"]
    assert main(["study", "make", str(folder), *flags]) == 0
    return folder


def test_each_person_has_a_result_and_one_picture_shows_both(folder, capsys):
    assert main(["track", str(folder), "-o", str(folder / "result.usdc"), "--device", "cpu", "--json"]) == 0
    people = json.loads(capsys.readouterr().out)["people"]
    assert list(people) == ["S1", "S2"]
    assert all(report["mpjpe_mm"] < 20 for report in people.values())
    files = [folder / f"result.{name}.usdc" for name in people]
    assert [read_result(file).config["person"] for file in files] == ["S1", "S2"]
    assert main(["eval", str(files[1]), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["mpjpe_mm"] == people["S2"]["mpjpe_mm"]
    assert list(results_in(folder / "result.usdc").values()) == files
    again = ["track", str(folder), "--person", "all", "-o", str(folder / "result.usdc"), "--device", "cpu", "--resume"]
    assert main([*again, "--json"]) == 0  # all of it is there
    assert list(json.loads(capsys.readouterr().out)["people"]) == ["S1", "S2"]
    alone, both = folder / "alone.webm", folder / "both.webm"
    assert main(["show", str(files[0]), "--whole", "-o", str(alone)]) == 0
    assert main(["show", str(files[0]), "--beside", str(files[1]), "--whole", "-o", str(both)]) == 0
    assert both.with_suffix(".png").stat().st_size > alone.with_suffix(".png").stat().st_size
    assert main(["show", str(folder / "result.usdc"), "--whole"]) == 0
    assert (folder / "result.png").read_bytes() == both.with_suffix(".png").read_bytes()


def test_one_of_them_is_chosen_by_name(folder, capsys):
    output = folder / "one.usdc"
    assert main(["track", str(folder), "--person", "S2", "-o", str(output), "--device", "cpu"]) == 0
    assert read_result(output).config["person"] == "S2"
    assert main(["track", str(folder), "--person", "S9", "-o", str(output), "--force"]) == 2
    assert "person S9 is not one of S1, S2" in capsys.readouterr().err
