"""``mmocap body``: bodies of other programs' characters and robots, and what is done with bodies."""

from __future__ import annotations

from cyclopts import App

app = App(name="body", help="Import another program's body, export, draw it, or learn its limits.", version_flags=[])
app.command(
    "mmocap_warp.cli.body_import:import_body", name="import", help="Write a body of a rigged character or a robot."
)
app.command("mmocap_warp.cli.body_export:export_body", name="export", help="Write a body as glTF, with its motions.")
app.command("mmocap_warp.cli.body_learn:learn", name="learn", help="Write a body that turns as far as it was seen to.")
app.command("mmocap_warp.cli.body_show:show_body", name="show", help="Draw a body, its joints and how they turn.")
