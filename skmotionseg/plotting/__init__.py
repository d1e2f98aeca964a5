"""Pictures of segmentations and of why they came out so.

Needs matplotlib, which the extra ``plot`` installs. The displays work as those of
scikit-learn do: made by ``from_estimator`` or ``from_predictions``, drawn again by
``plot``, with axes and artists as attributes.
"""

from ._affinities import AffinityDisplay
from ._counts import CountDisplay
from ._errors import SequenceErrorDisplay
from ._report import ReportDisplay
from ._sweeps import FusionWeightDisplay, GridDisplay
from ._tracks import MotionDisplay, plot_motions

__all__ = [
    "AffinityDisplay",
    "CountDisplay",
    "FusionWeightDisplay",
    "GridDisplay",
    "MotionDisplay",
    "ReportDisplay",
    "SequenceErrorDisplay",
    "plot_motions",
]
