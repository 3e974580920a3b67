"""The report in a browser, where there is one: its structure is tested everywhere, see test_study_report.py."""

from importlib.resources import files

import pytest
from browser import AXE, Browser, find_browser, violations
from study_results import SEQUENCES, made_up_study

from mmocap_warp.study.report_build import render
from mmocap_warp.study.report_tables import difference_table, ranking_table, sequence_table
from mmocap_warp.study.study_tables import by_algorithm, by_model, model_differences
from mmocap_warp.study.summary import StudySummary

PROGRAM = find_browser()


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A report of two sequences, both models and two budgets."""
    study = StudySummary.of(made_up_study(("S1/Walking", "S2/Box"), budgets=(500, 1500), seeds=3, frames=40))
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(render(study, {}), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    """A browser that all tests share; each opens the page anew."""
    with Browser(PROGRAM, tmp_path_factory.mktemp("profile")) as browser:
        yield browser


@pytest.fixture
def browser(started, page):
    started.ask("Emulation.setDeviceMetricsOverride", width=1200, height=900, deviceScaleFactor=1, mobile=False)
    started.ask("Emulation.setEmulatedMedia", media="", features=[])
    started.ask("Emulation.setScriptExecutionDisabled", value=False)
    started.open(page)
    return started


SHOWN = (
    """[...document.querySelectorAll("%s .choice")].filter((part) => !part.hidden).map((part) => ({...part.dataset}))"""
)


def shown(browser, section):
    """What the parts of a section that can be seen are of."""
    return browser.run(SHOWN % f"#{section}")


def choose(browser, name, value):
    browser.run(
        f"""(() => {{
            const select = document.querySelector("select[name={name}]");
            select.value = "{value}";
            select.dispatchEvent(new Event("change", {{bubbles: true}}));
        }})()"""
    )


def test_it_loads_without_an_error_and_asks_nobody(browser, page):
    requests = [request["request"]["url"] for request in browser.told("Network.requestWillBeSent")]
    assert [url for url in requests if not url.startswith("data:")] == [page.resolve().as_uri()]
    assert browser.told("Runtime.exceptionThrown") == []
    assert browser.told("Runtime.consoleAPICalled") == []
    assert browser.told("Log.entryAdded") == []


def test_controls_choose_what_is_shown(browser):
    assert browser.run("document.querySelector('.controls').hidden") is False
    first = {"curve": "mpjpe", "sequence": "S1/Walking", "model": "39", "budget": "500"}
    grown = {"model": "39", "budget": "500"}
    assert shown(browser, "curves") == [grown, first]
    choose(browser, "sequence", "S2/Box")
    choose(browser, "model", "28")
    choose(browser, "budget", "1500")
    other = {"model": "28", "budget": "1500"}
    assert shown(browser, "curves") == [other, first | other | {"sequence": "S2/Box"}]
    assert shown(browser, "spread") == [{"measure": "mpjpe", "budget": "1500"}]
    choose(browser, "measure", "iou")
    assert shown(browser, "curves")[1]["curve"] == "iou"
    assert {part["measure"] for part in shown(browser, "ranks")} == {"iou"}
    choose(browser, "measure", "jerk")  # has no curve: the first measure's stays
    assert shown(browser, "curves")[1]["curve"] == "mpjpe"
    assert browser.told("Runtime.exceptionThrown") == []


def test_a_legend_singles_an_algorithm_out(browser):
    faded = "[...document.querySelectorAll('main svg .faded')].length"
    press = "document.querySelector('#curves .legend button[value=\"de\"]').click()"
    assert browser.run(faded) == 0
    browser.run(press)
    assert browser.run(faded) > 0
    assert browser.run("[...document.querySelectorAll('svg .a-de.faded')].length") == 0
    assert browser.run("document.querySelector('.legend button[value=\"de\"]').ariaPressed") == "true"
    browser.run(press)
    assert browser.run(faded) == 0


@pytest.mark.parametrize("width", [320, 390, 768, 1280])
def test_nothing_is_wider_than_the_screen(browser, width):
    """Wide tables and figures scroll on their own; the page does not."""
    browser.ask("Emulation.setDeviceMetricsOverride", width=width, height=800, deviceScaleFactor=1, mobile=width < 600)
    assert browser.run("document.documentElement.scrollWidth") <= width


def test_every_table_of_the_paper_s_grid_fits_a_small_screen(browser, tmp_path):
    """Nine sequences, eight algorithms, two models, three budgets, every measure: nothing to scroll for at 1,280 px."""
    study = StudySummary.of(made_up_study(SEQUENCES, budgets=(500, 1500, 3000), seeds=2, frames=6))
    tables = []
    for measure in study.measures:
        tables += [sequence_table(study, measure, budget) for budget in study.budgets]
        tables.append(difference_table(model_differences(study, measure), measure, study.models))
        tables += [
            ranking_table([by_model(study, measure, name) for name in names], "a caption")
            for names in (study.hierarchical, study.holistic)
        ]
        for dof in study.models:
            tables.append(ranking_table([by_algorithm(study, measure, dof, each) for each in study.budgets], "another"))
    css = files("mmocap_warp.study").joinpath("report.css").read_text(encoding="utf-8")
    page = tmp_path / "tables.html"
    shown_tables = "".join(table.html() for table in tables)
    page.write_text(f"<!doctype html><meta charset=utf-8><style>{css}</style><main>{shown_tables}</main>")
    browser.ask("Emulation.setDeviceMetricsOverride", width=1280, height=800, deviceScaleFactor=1, mobile=False)
    browser.open(page)
    shown = "[...document.querySelectorAll('.wide')]"
    assert browser.run(f"{shown}.length") == len(tables)
    assert browser.run(f"{shown}.filter((it) => it.scrollWidth > it.clientWidth).map((it) => it.innerText)") == []


def test_it_reads_without_its_script(browser, page):
    browser.ask("Emulation.setScriptExecutionDisabled", value=True)
    browser.open(page)
    assert browser.run("document.querySelector('.controls').hidden") is True
    for section in ("ranks", "spread", "curves", "budget", "models"):
        assert shown(browser, section)


def test_dark_and_print_have_their_colours(browser):
    paper = "getComputedStyle(document.body).backgroundColor"
    assert browser.run(paper) == "rgb(255, 255, 255)"
    dark = [{"name": "prefers-color-scheme", "value": "dark"}]
    browser.ask("Emulation.setEmulatedMedia", media="", features=dark)
    assert browser.run(paper) == "rgb(20, 23, 27)"
    browser.ask("Emulation.setEmulatedMedia", media="print", features=dark)
    assert browser.run(paper) == "rgb(255, 255, 255)"
    assert browser.run("getComputedStyle(document.querySelector('.controls')).display") == "none"


@pytest.mark.skipif(AXE is None, reason="axe-core is not installed")
@pytest.mark.parametrize("width", [390, 1200])
def test_axe_finds_nothing(browser, width):
    browser.ask("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=width < 600)
    browser.run("new Promise((done) => requestAnimationFrame(() => setTimeout(done, 50)))")
    assert violations(browser) == []
