"""``python -m mmocap_warp`` is ``mmocap``."""

import sys

from mmocap_warp.cli import main

sys.exit(main())
