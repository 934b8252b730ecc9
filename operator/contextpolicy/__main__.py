"""`python -m contextpolicy` is `contextpolicy`."""

import sys

from contextpolicy.cli import main

sys.exit(main())
