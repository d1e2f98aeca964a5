"""The colours of all pictures, told apart by colour-blind readers."""

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
# How much of black or white is mixed into them where there are more motions than these.
SHADES = ((0.0, 0), (0.45, 0), (0.5, 255))
OUTLIER_COLOUR = "#b0b0b0"
# Curves and bars on white, which have no background among them: the same colours,
# without the quiet one.
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e6ac00", "#56b4e9", "#222222")
# matplotlib's names of colour maps whose lightness alone tells the order: high
# affinities are bright, high errors dark.
AFFINITY_MAP = "magma"
ERROR_MAP = "cividis_r"
OUTLINE_COLOUR = "#56b4e9"


def motion_colour(label):
    """The colour, as ``"#rrggbb"``, of a motion's number; -1 is grey.

    Ten are as in ``COLOURS``, the ten that follow darker, and then ten lighter.
    """
    if label < 0:
        return OUTLIER_COLOUR
    turn, position = divmod(label, len(COLOURS))
    share, towards = SHADES[turn % len(SHADES)]
    parts = red_green_blue(COLOURS[position])
    mixed = [round((1 - share) * part + share * towards) for part in parts]
    return "#" + "".join(f"{part:02x}" for part in mixed)


def red_green_blue(colour):
    """The parts, from 0 to 255, of a colour ``"#rrggbb"``."""
    return tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))


def series_colour(position):
    """The colour, as ``"#rrggbb"``, of a curve or of a row of bars."""
    return SERIES[position % len(SERIES)]
