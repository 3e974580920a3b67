"""Calibrations exported by Qualisys Track Manager (``.qca.txt``, XML inside)."""

import math
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from mmocap_warp.cameras.rig import Camera, CameraRig, rig_of
from mmocap_warp.errors import InputError, input_errors
from mmocap_warp.formats.calibration.calibration_text import MOST_BYTES, Sizes, number_of
from mmocap_warp.whole_file import read_bytes

_SUBPIXELS = 64.0  # focal lengths and centres are written in 1/64 px; distortion coefficients are not scaled
_FROM_QUALISYS = np.diag([1.0, -1.0, -1.0])  # its cameras look along -z with y up


def read_qualisys(path: str | Path, units: str | None = None, up: str = "+z", sizes: Sizes = None) -> CameraRig:
    """Read a ``.qca.txt``; its lengths are millimetres by definition, its world has z up.

    ``units`` and ``sizes`` are not needed.

    The convention was checked against the board pictures of Pose2Sim's single-person demo:
    ``R = diag(1, -1, -1) [[r11 r12 r13] ..]`` and ``x_cam = R (X - position / 1000)``.
    """
    data = read_bytes(path, "give a .qca.txt file", most=MOST_BYTES)
    kinds = ParseError, DefusedXmlException, ValueError, LookupError
    with input_errors(path, "is not valid XML: {error}", "export the calibration again", *kinds):
        root = fromstring(data)
    return rig_of([_read_camera(camera, path) for camera in root.iter("camera")], up, path)


def _read_camera(camera: Element, path: str | Path) -> Camera:
    name = camera.get("serial", "")
    where = f"{path}: camera '{name}'"

    def number(element: str, attribute: str) -> float:
        node = camera.find(element)
        text = None if node is None else node.get(attribute)
        if text is None:
            raise InputError(where, f"<{element} {attribute}=...> is missing", "export the calibration again")
        if not math.isfinite(value := number_of(text)):
            raise InputError(where, f"{attribute} = {text!r} is not a number", "export the calibration again")
        return value

    R = _FROM_QUALISYS @ [[number("transform", f"r{i}{j}") for j in (1, 2, 3)] for i in (1, 2, 3)]
    position = np.array([number("transform", axis) for axis in "xyz"]) / 1000
    keys = "focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew"
    fx, fy, cx, cy, skew = (number("intrinsic", key) / _SUBPIXELS for key in keys)
    cx, cy = cx - number("fov_video", "left"), cy - number("fov_video", "top")  # stated on the whole sensor
    kinds = ("radial", 1), ("radial", 2), ("tangental", 1), ("tangental", 2), ("radial", 3)  # its spelling
    distortion = [number("intrinsic", f"{kind}Distortion{n}") for kind, n in kinds]
    width = int(number("fov_video", "right") - number("fov_video", "left")) + 1
    height = int(number("fov_video", "bottom") - number("fov_video", "top")) + 1
    K = np.array([[fx, skew, cx], [0, fy, cy], [0, 0, 1]])
    return Camera(name, K, R, -R @ position, (width, height), np.array(distortion))
