"""``mmocap calib``: calibrations, converted from other programs' and judged by the person who was recorded."""

from __future__ import annotations

from cyclopts import App

app = App(name="calib", help="Calibrations: convert, check, refine and solve them.", version_flags=[])
_CONVERT = (
    "Write a calibration in another program's format.\n\n"
    "Reads TOML of Pose2Sim, aniposelib and Caliscope, Qualisys, YAML of OpenCV and EasyMocap, COLMAP text, MultiCal, "
    "HumanEva and USD; writes TOML, YAML, COLMAP text and USD. Lengths are written in metres."
)
_CHECK = (
    "Say which camera disagrees with the others, and why.\n\n"
    "Told by the person before the cameras. Exits with 4 where one disagrees."
)
_REFINE = (
    "Refine a scene's cameras and their times by the person before them.\n\n"
    "Frames that had no part in it judge the result. Exits with 4, and writes nothing, where they are explained no "
    "better than before."
)
_SOLVE = (
    "Find a scene's cameras from nothing but one person of known height who walks about.\n\n"
    "The scene needs no calibration. Exits with 4, and writes nothing, where the recording does not tell them: nobody "
    "walks, too few frames show the whole person, or the views do not agree."
)
_COMMANDS: tuple[tuple[str, str, str], ...] = (
    # (name, module:function, help): the help is here and not in a docstring, so that the list of commands loads none
    ("convert", "calib_solve:convert", _CONVERT),
    ("check", "calib_adjust:check", _CHECK),
    ("refine", "calib_adjust:refine", _REFINE),
    ("solve", "calib_solve:solve", _SOLVE),
)
for _order, (_name, _target, _help) in enumerate(_COMMANDS):
    app.command(f"mmocap_warp.cli.{_target}", name=_name, help=_help, sort_key=_order)
