"""The files around the code agree with one another and with the tree."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

import mmocap_warp

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
MAPPED = {"mmocap_warp": "mmocap_warp", "mmocap_warp.kernels": "kernels", "mmocap_warp.scenes": "scenes"}


def package_names() -> set[str]:
    """Every folder of modules in the checkout, under the name it is installed as."""
    names = set()
    for package, folder in MAPPED.items():
        for init in (ROOT / folder).rglob("__init__.py"):
            below = init.parent.relative_to(ROOT / folder).parts
            names.add(".".join([package, *below]))
    return names


def test_every_package_of_the_tree_is_installed():
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == package_names()


def test_folders_are_mapped_as_the_tests_assume():
    assert PROJECT["tool"]["setuptools"]["package-dir"] == MAPPED


def test_version_is_the_same_in_the_citation():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (\S+)$", citation, re.M)[1] == mmocap_warp.__version__


def test_the_changelog_begins_with_what_is_unreleased_and_then_has_this_version():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^## \[(\S+)\]", changelog, re.M)[:2] == ["Unreleased", mmocap_warp.__version__]


def test_what_runs_before_a_commit_runs_in_ci():
    hooks = re.findall(r"entry: (.+)", (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
    lines = (ROOT / ".ci" / "run").read_text(encoding="utf-8").replace(" --check", "").splitlines()
    checks = [line.strip() for line in lines]
    assert hooks
    assert [hook for hook in hooks if hook not in checks] == []


def test_readme_opens_with_the_two_commands():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    first = readme.index("pip install -e . && mmocap demo")
    second = readme.index('pip install -e ".[test]" && pytest')
    assert first < second < readme.index("\n## ")


def test_ci_runs_the_readmes_test_command():
    assert 'pip install -e ".[test]" && pytest' in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def test_licence_names_agree():
    assert PROJECT["project"]["license"].startswith("Apache-2.0 AND ")
    assert (ROOT / "LICENSE").read_text(encoding="utf-8").lstrip().startswith("Apache License")


def test_links_between_documents_lead_somewhere():
    broken = []
    for page in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("scenes/**/*.md")]:
        for target in re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8")):
            if "://" not in target and not (page.parent / target).exists():
                broken.append(f"{page.relative_to(ROOT)}: {target}")
    assert not broken


@pytest.mark.parametrize(
    ("file", "extras"), [("requirements-dev.txt", ["test", "dev"]), ("requirements-docs.txt", ["docs"])]
)
def test_a_lock_has_every_requirement_with_hashes(file, extras):
    lock = (ROOT / file).read_text(encoding="utf-8")
    packages = re.findall(r"^([a-z0-9-]+)==(\S+)(.*?)(?=^\S|\Z)", lock, re.M | re.S)
    assert [name for name, _, rest in packages if "--hash=sha256:" not in rest] == []
    locked = {name: version for name, version, _ in packages}
    optional = PROJECT["project"]["optional-dependencies"]
    for text in [*PROJECT["project"]["dependencies"], *(text for extra in extras for text in optional[extra])]:
        required = Requirement(text)
        assert required.specifier.contains(locked[required.name]), f"{text} against {locked[required.name]}"


def test_the_conda_recipe_needs_what_the_package_needs():
    recipe = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    assert recipe["context"]["version"] == mmocap_warp.__version__
    assert PROJECT["project"]["requires-python"] == f">={recipe['context']['python_min']}"
    (command,) = PROJECT["project"]["scripts"].items()
    assert recipe["build"]["python"]["entry_points"] == [" = ".join(command)]
    on_conda = {"opencv-python-headless": "py-opencv", "usd-core": "openusd"}
    wanted = [Requirement(text) for text in PROJECT["project"]["dependencies"]]
    named = {f"{on_conda.get(required.name, required.name)} {required.specifier}" for required in wanted}
    assert named == set(recipe["requirements"]["run"]) - {"python >=${{ python_min }}"}


def test_the_paper_has_the_journals_sections_and_cites_what_its_bibliography_holds():
    paper = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")
    assert re.findall(r"^# (.+)$", paper, re.M) == [
        "Summary",
        "Statement of need",
        "State of the field",
        "Software design",
        "Research impact statement",
        "AI usage disclosure",
        "Acknowledgements",
        "References",
    ]
    assert 750 <= len(paper.split("# Summary")[1].split()) <= 1750
    cited = set(re.findall(r"@(\w+)", paper))
    held = re.findall(r"^@\w+\{(\w+),$", (ROOT / "paper" / "paper.bib").read_text(encoding="utf-8"), re.M)
    assert cited == set(held)
    assert len(held) == len(set(held))


def test_every_dependency_of_a_user_states_its_licence():
    told = subprocess.run([sys.executable, ROOT / ".ci" / "licences"], capture_output=True, text=True)
    assert told.returncode == 0, told.stdout
    assert re.search(r"^warp-lang +\S+ +Apache-2\.0$", told.stdout, re.M)
