"""`python -m maxjax`: the same as the console script `maxjax`."""

from __future__ import annotations

import sys

from maxjax.ui.cli import main

sys.exit(main())
