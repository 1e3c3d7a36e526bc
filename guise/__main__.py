"""`python -m guise`: the command line."""

import sys

from guise.app.cli.main import main

sys.exit(main())
