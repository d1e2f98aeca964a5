"""``python -m skmotionseg`` is the ``skmotionseg`` command."""

import sys

from .cli import main

if __name__ == "__main__":
    sys.exit(main())
