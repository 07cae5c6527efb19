"""`python -m maglev_ctrl` is the `maglev-ctrl` command."""

import sys

from maglev_ctrl.cli import main

if __name__ == "__main__":
    sys.exit(main())
