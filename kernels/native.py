"""Native code, C++ and CUDA, that Warp puts into functions: it lies in a ``.cu`` file beside the module that uses it.

A file has a section for each function, which begins with a line ``// ==== name``. ``${OTHER}`` stands for the section
of that name in the same file, or for a constant that the module gives.
"""

import re
from collections.abc import Callable
from pathlib import Path
from string import Template

_HEAD = re.compile(r"^// ==== (\w+)\n", re.MULTILINE)


def native_sections(module_file: str) -> Callable[..., str]:
    """What gives the sections of native code beside a ``module_file``: called with a name and its constants."""
    _, *parts = _HEAD.split(Path(module_file).with_suffix(".cu").read_text(encoding="utf-8"))
    sections = dict(zip(parts[::2], parts[1::2], strict=True))

    def section(name: str, **constants: int) -> str:
        return Template(sections[name]).substitute(sections, **constants)

    return section
