"""``--rerun`` without Rerun."""

from __future__ import annotations

import sys

import pytest
from shown import made_result

from mmocap_warp.display.page.rerun_file import write_rerun
from mmocap_warp.errors import InputError


def test_without_rerun_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match=r"rerun-sdk.*mmocap-warp\[viewer\]"):
        write_rerun(tmp_path / "r.rrd", made_result(frames=2))
    assert not (tmp_path / "r.rrd").exists()
