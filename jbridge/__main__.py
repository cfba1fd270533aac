"""`python -m jbridge` is the command `jbridge`."""

import sys

from jbridge.cli import main

if __name__ == "__main__":
    sys.exit(main())
