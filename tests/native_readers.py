"""Readers that do to their process what native code does when a file is damaged."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from mmocap_warp.formats.sandbox import sandboxed

TRIED = "tried by"


@sandboxed
def read(path: Path) -> str:
    """The file's text; some texts are no good."""
    text = Path(path).read_text()
    match text:
        case "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "killed":  # once, by somebody else
            if not (mark := Path(path).with_suffix(".mark")).exists():
                mark.touch()
                os.kill(os.getpid(), signal.SIGKILL)
        case "loop":
            while True:
                pass
        case "swell":
            bytearray(4 * 2**30)
    with Path(path).with_suffix(".log").open("a") as log:
        print(os.getpid(), file=log)
    return text
