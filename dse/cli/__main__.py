"""`python -m dse.cli` is `dse`."""

import sys

from dse.cli import main

sys.exit(main())
