"""One colour a motion, the same in all pictures."""

from __future__ import annotations

# Okabe and Ito's colours, told apart by colour-blind readers, then others for more
# than seven motions. The background, usually the largest motion, is the quietest.
COLOURS = (
    "#7f9db9",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e6ac00",
    "#0072b2",
    "#8c564b",
    "#17becf",
    "#7b3294",
    "#a6d854",
)
OUTLIER_COLOUR = "#b0b0b0"


def motion_colour(label):
    """The colour, as ``"#rrggbb"``, of a motion's number; -1 is grey."""
    return OUTLIER_COLOUR if label < 0 else COLOURS[label % len(COLOURS)]
