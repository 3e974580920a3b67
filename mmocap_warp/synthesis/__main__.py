"""``python -m mmocap_warp.synthesis FOLDER``: make the built-in walking scene again."""

import sys

from mmocap_warp.errors import InputError
from mmocap_warp.synthesis.walk import walking, write_walk

if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("usage: python -m mmocap_warp.synthesis FOLDER")
    try:
        print(f"wrote {write_walk(sys.argv[1], walking())}")
    except InputError as error:
        print(error, file=sys.stderr)
        raise SystemExit(3) from None
