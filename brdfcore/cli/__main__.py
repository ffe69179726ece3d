"""`python -m brdfcore.cli`: the same as the command `brdf`."""

import sys

from brdfcore.cli import main

if __name__ == "__main__":
    sys.exit(main())
