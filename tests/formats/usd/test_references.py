"""USD files that name others: followed in their own folder, refused by name elsewhere before they are opened."""

from __future__ import annotations

import pytest
from synthetic import synthetic_body

from mmocap_warp import cli
from mmocap_warp.cli.console import BAD_INPUT
from mmocap_warp.errors import InputError
from mmocap_warp.formats.usd.usd_body import read_body, write_body
from mmocap_warp.formats.usd.usd_check import faults

CLIPS = 'clips = {{ dictionary default = {{ {} double templateStride = 1\nstring primPath = "/Boxes" }} }}'
NAMES = {  # what stands before the prims, in a prim's metadata, and in the prim
    "sublayer": ("subLayers = [@{}@]", "", ""),
    "reference": ("", "references = @{}@", ""),
    "payload": ("", "payload = @{}@", ""),
    "clip": ("", CLIPS.format("asset[] assetPaths = [@{}@]\n").replace("{{", "{").replace("}}", "}"), ""),
    "template of clips": ("", 'clips = { dictionary default = { string templateAssetPath = "{}" } }', ""),
    "asset": ("", "", "asset inputs:file = @{}@"),
    "asset in time": ("", "", "asset inputs:file.timeSamples = { 1: @{}@ }"),
    "variant": ("", 'prepend variantSets = "v"', 'variantSet "v" = {\n"a" (references = @{}@) {\n}\n}'),
    "expression": ("", 'references = @`"{}"`@', ""),
}


def naming(where: str, name: str) -> str:
    """A USD file that names another."""
    layer, prim, inside = (part.replace("{}", name) for part in NAMES[where])
    return f'#usda 1.0\n(\nmetersPerUnit = 1\n{layer}\n)\ndef Xform "Other" (\n{prim}\n)\n{{\n{inside}\n}}\n'


@pytest.mark.parametrize("where", NAMES)
@pytest.mark.parametrize("name", ["../secret.usda", "{folder}/secret.usda", "beside/../../secret.usda"])
def test_a_file_elsewhere_is_refused_by_name(tmp_path, where, name):
    write_body(tmp_path / "secret.usda", synthetic_body())
    (tmp_path / "in").mkdir()
    (tmp_path / "in/body.usda").write_text(naming(where, name.format(folder=tmp_path)))
    with pytest.raises(InputError, match=r"body\.usda: refers to .*(secret\.usda|clips).*--allow-references"):
        read_body(tmp_path / "in/body.usda")
    (fault,) = faults(tmp_path / "in/body.usda")
    assert fault.startswith("refers to ")


def test_a_file_elsewhere_is_not_found_by_way_of_one_beside(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in/beside.usda").write_text(naming("payload", "../secret.usda"))
    (tmp_path / "in/body.usda").write_text(naming("sublayer", "beside.usda"))
    with pytest.raises(InputError, match=r"beside\.usda: refers to .*secret\.usda"):
        read_body(tmp_path / "in/body.usda")


def test_a_link_that_leads_elsewhere_is_refused(tmp_path):
    write_body(tmp_path / "secret.usda", synthetic_body())
    (tmp_path / "in").mkdir()
    (tmp_path / "in/beside.usda").symlink_to(tmp_path / "secret.usda")
    (tmp_path / "in/body.usda").write_text(naming("sublayer", "beside.usda"))
    with pytest.raises(InputError, match="refers to"):
        read_body(tmp_path / "in/body.usda")


@pytest.mark.parametrize("name", ["beside.usda", "./beside.usda", "{folder}/beside.usda"])
def test_a_file_in_the_same_folder_is_followed(tmp_path, name, monkeypatch):
    write_body(tmp_path / "beside.usda", synthetic_body())
    (tmp_path / "body.usda").write_text(naming("sublayer", name.format(folder=tmp_path)))
    monkeypatch.chdir("/")
    assert read_body(tmp_path / "body.usda").name == "Boxes"


def test_a_file_elsewhere_is_followed_where_that_is_allowed(tmp_path, capsys, monkeypatch):
    monkeypatch.delenv("MMOCAP_DEBUG", raising=False)
    write_body(tmp_path / "secret.usda", synthetic_body())
    (tmp_path / "in").mkdir()
    path = tmp_path / "in/body.usda"
    path.write_text(naming("sublayer", "../secret.usda"))
    assert cli.main(["eval", str(path)]) == BAD_INPUT
    assert "refers to" in capsys.readouterr().err
    assert cli.main(["eval", str(path), "--allow-references"]) == BAD_INPUT
    assert "holds no tracking result" in capsys.readouterr().err
    monkeypatch.setenv("MMOCAP_ALLOW_REFERENCES", "1")
    assert read_body(path).name == "Boxes"
