"""``python -m mmocap_warp.synthesis FOLDER``: make the built-in walking scene again, or with something carried."""

import sys
from pathlib import Path

from mmocap_warp.errors import InputError
from mmocap_warp.synthesis.carried import CARRIED, write_carried
from mmocap_warp.synthesis.walk import walking, write_walk

if __name__ == "__main__":
    if len(sys.argv) not in (2, 3) or not set(sys.argv[2:]) <= set(CARRIED):
        raise SystemExit(f"usage: python -m mmocap_warp.synthesis FOLDER [{'|'.join(CARRIED)}]")
    try:
        made = [write_carried(Path(sys.argv[1]), name) for name in sys.argv[2:]]
        print(f"wrote {made[0] if made else write_walk(sys.argv[1], walking())}")
    except InputError as error:
        print(error, file=sys.stderr)
        raise SystemExit(3) from None
