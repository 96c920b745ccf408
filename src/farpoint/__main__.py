"""``python -m farpoint``."""

import sys

from farpoint.cli import main

sys.exit(main())
