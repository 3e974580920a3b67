"""What a result depends on besides its settings: the versions of packages, and the device."""

from collections.abc import Iterable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

from mmocap_warp.version import __version__

PACKAGES = ("mmocap-warp", "warp-lang", "usd-core", "opencv-python-headless", "opencv-python", "numpy")
"""Those that decide a result's bits; OpenCV comes under two names."""


def package_versions(names: Iterable[str] = PACKAGES) -> dict[str, str]:
    """Versions by name, without those that are not installed. This package's own is known even where it only lies on
    Python's path."""
    versions = {}
    for name in names:
        with suppress(PackageNotFoundError):
            versions[name] = __version__ if name == "mmocap-warp" else version(name)
    return versions


def versions(device: str) -> dict[str, str]:
    """What produced a result: versions of ``PACKAGES``, and the name of a Warp device under ``device``."""
    import warp as wp

    return package_versions() | {"device": wp.get_device(device).name}
