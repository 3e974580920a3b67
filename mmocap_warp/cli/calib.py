"""``mmocap calib``: calibrations, converted from other programs' and judged by the person who was recorded."""

from __future__ import annotations

from cyclopts import App

app = App(name="calib", help="Calibrations: convert, check and refine them.", version_flags=[])
_COMMANDS: tuple[tuple[str, str, str], ...] = (
    # (name, module:function, help): the help is here and not in a docstring, so that the list of commands loads none
    (
        "refine",
        "calib_refine:refine",
        "Refine a scene's cameras and their times by the person before them.\n\nFrames that had no part in it judge the "
        "result; exits with 4, and writes nothing, where they are explained no better.",
    ),
)
for _order, (_name, _target, _help) in enumerate(_COMMANDS):
    app.command(f"mmocap_warp.cli.{_target}", name=_name, help=_help, sort_key=_order)
