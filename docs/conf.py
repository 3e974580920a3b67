"""Sphinx's settings for the documentation site; CONTRIBUTING.md has the command that builds it."""

import html
import json
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import ziamath
from docutils import nodes
from sphinx.application import Sphinx

import mmocap_warp

sys.path.append(str(Path(__file__).resolve().parents[1] / "instruments"))
from bench_report import PAGE, report_page
from study_figures import study_page

project = "mmocap-warp"
author = "The mmocap-warp contributors"
copyright = author
version = release = mmocap_warp.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_output_stderr = "remove"
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"

html_theme = "furo"
html_title = f"mmocap-warp {version}"
html_copy_source = False
html_math_renderer = "drawn"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
ziamath.config.svg2 = False  # outlines in their place, for a name in one drawing is a name in all of the page

_ABOVE = {"../CONTRIBUTING.md": "contributing.md", "../CHANGELOG.md": "changelog.md"}
"""Documents beside this folder, and the pages that hold them here."""


def _draw(translator: Any, node: nodes.math | nodes.math_block) -> None:
    """Formulas become drawings in the page, in its colour: no script and no font is asked for."""
    tex = node.astext()
    inline = isinstance(node, nodes.math)
    formula = ziamath.Latex(tex, inline=inline, size=19, color="currentColor")
    place = f"vertical-align: {formula.getyofst():.1f}px" if inline else "max-width: 100%"
    named = f'<svg role="img" aria-label="{html.escape(tex)}" style="{place}" '
    drawing = formula.svg().replace("<svg ", named, 1)
    translator.body.append(drawing if inline else f'<p class="formula">{drawing}</p>')
    raise nodes.SkipNode


def _link_to_pages(_app: Sphinx, _page: str, source: list[str]) -> None:
    for file, page in _ABOVE.items():
        source[0] = re.sub(rf"\]\({re.escape(file)}\b", f"]({page}", source[0])


def _list_registries(_app: Sphinx, _page: str, source: list[str]) -> None:
    """Replace ``<!-- list: module:REGISTRY, ... -->`` by what the program's registries hold when the site is built."""

    def entries(comment: re.Match[str]) -> str:
        names: list[str] = []
        for registry in comment[1].split(","):
            module, _, name = registry.strip().partition(":")
            names.extend(map(str, getattr(import_module(module), name)))
        return ", ".join(f"`{name}`" for name in names)

    source[0] = re.sub(r"<!-- list: (.+?) -->", entries, source[0])


def _write_times(app: Sphinx) -> None:
    """Write the page of times from the reports beside it; the page is not tracked."""
    folder = Path(app.srcdir) / "benchmarks"
    reports = [json.loads((folder / name).read_bytes()) for name in ("cpu.json", "h200.json")]
    (folder / PAGE).write_text(report_page(reports), encoding="utf-8")


def _fill_findings(_app: Sphinx, page: str, source: list[str]) -> None:
    """The page on the study has its figures from the results beside it, whatever was written there last."""
    if page == "study/README":
        source[0] = study_page()


def setup(app: Sphinx) -> None:
    """Register how formulas are drawn, where links lead, and what is made from data and registries."""
    app.connect("builder-inited", _write_times)
    app.add_html_math_renderer("drawn", (_draw, None), (_draw, None))
    app.connect("source-read", _fill_findings)
    app.connect("source-read", _link_to_pages)
    app.connect("source-read", _list_registries)
