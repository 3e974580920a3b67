"""The one list of what results depend on."""

from __future__ import annotations

import mmocap_warp
from mmocap_warp.versions import package_versions, versions


def test_a_package_that_is_not_installed_has_no_version():
    assert set(package_versions(["numpy", "a-package-that-nobody-wrote"])) == {"numpy"}


def test_our_own_version_is_known_without_an_installed_distribution(no_distribution):
    known = versions("cpu")
    assert known["mmocap-warp"] == mmocap_warp.__version__
    assert {"warp-lang", "usd-core", "numpy", "device"} <= set(known)
