"""Lines of progress on standard error."""

from __future__ import annotations

import re


def without_progress(errors):
    """What a command said on standard error besides how far it is."""
    return re.sub(r"(?m)^\w+: \d+ of \d+ done\n", "", errors)
