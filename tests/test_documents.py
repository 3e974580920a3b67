"""What the documents show works."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def example(page: str, of: int = 0) -> str:
    """A page's Python example."""
    return re.findall(r"```python\n(.*?)```", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.S)[of]


def test_the_optimizers_example_finds_the_minimum(tmp_path):
    script = tmp_path / "example.py"
    script.write_text(example("optimizers.md"))
    answer = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=True)
    costs = [float(cost) for cost in answer.stdout.splitlines()[-1].strip("[]").split()]
    assert len(costs) == 5
    assert min(costs) < 1e-6


def test_the_line_from_python_names_what_exists(tmp_path):
    imports = [line for line in example("architecture.md").splitlines() if line.startswith("from ")]
    assert len(imports) == 7
    subprocess.run([sys.executable, "-c", "\n".join(imports)], check=True)


def test_documents_that_the_code_names_exist():
    named = set()
    for file in [*ROOT.glob("kernels/**/*.py"), *ROOT.glob("mmocap_warp/**/*.py")]:
        named.update(re.findall(r"docs/\w+\.md", file.read_text(encoding="utf-8")))
    assert named
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []
