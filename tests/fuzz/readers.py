"""Everything that reads a file: how a small sound file comes to be, how it is damaged, and how it is read.

A new reader of files is a line in ``READERS`` of the module of its kind. What it needs is imported by its functions, so
that a trial of one reader does not wait for the others.
"""

from __future__ import annotations

import calibration_readers
import kept_readers
import motion_readers
import rigged_readers
import scene_readers
import tree_readers
import usd_readers
from reader import Reader

READERS: dict[str, Reader] = {
    reader.name: reader
    for kind in (
        *(scene_readers, tree_readers, calibration_readers, usd_readers, motion_readers, rigged_readers),
        kept_readers,
    )
    for reader in kind.READERS
}
