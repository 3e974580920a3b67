"""``mmocap study``: trackers compared over a grid of sequences, models and budgets."""

from __future__ import annotations

from cyclopts import App

app = App(name="study", help="Compare trackers: run a grid of them, and report on it.", version_flags=[])
_RUN = (
    "Track every cell of a study whose result is missing.\n\n"
    "A cell is one algorithm, model and budget on one sequence, all seeds at once. Interrupted at any moment, the same "
    "command goes on and repeats no finished cell; so it does after cells were added, or results of another machine "
    "copied into the folder. Exits with 1 if cells are missing in the end."
)
_COMMANDS = (  # a command's help is here and not in its docstring, so that the list of commands loads none of them
    ("make", "study_make:make", "Write shipped sequences as scenes, to look at or to track on their own."),
    ("run", "study_run:run", _RUN),
    ("ablate", "study_ablate:ablate", "Track clips, made worse in several ways, with several trackers."),
    ("show", "study_show:show", "List a folder's results, checking every byte. Exits with 4 if one is damaged."),
    ("report", "study_report:report", "Write a study's results as one HTML page."),
)
for _order, (_name, _target, _help) in enumerate(_COMMANDS):
    app.command(f"mmocap_warp.cli.{_target}", name=_name, help=_help, sort_key=_order)
