"""`python -m resting_aspects_ros.cli` runs the command `resting_aspects`."""

import sys

from resting_aspects_ros.cli.main import main

sys.exit(main())
