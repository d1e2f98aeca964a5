"""
Tracks that belong to no motion
===============================

A point tracker loses its point now and then, and the track wanders off.
:class:`~skmotionseg.MotionSegmenter` puts such a track where it fits least badly.
:func:`~skmotionseg.preprocessing.select_inliers` tells which tracks do not obey the
epipolar geometry of the motion they were put into.
"""

import matplotlib.pyplot as plt
import numpy as np

from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.plotting import plot_motions
from skmotionseg.preprocessing import select_inliers

X, y = make_rigid_motions(300, 12, 3, outliers=0.1, missing=0.1, random_state=0)
labels = MotionSegmenter(3, random_state=0).fit_predict(X)
kept = select_inliers(X, labels, whisker=3)

wandering = y == -1
print(f"of {wandering.sum()} that wander, rejected: {(wandering & ~kept).sum()}")
print(f"of {(~wandering).sum()} others, rejected: {(~wandering & ~kept).sum()}")

# %%
# What is rejected gets the label -1. The tracks that wander are circled: a circle
# without a cross is one that stayed, a cross without a circle would be one too many.

first, last = 4, 7
figure, ax = plt.subplots(figsize=(7, 4.8), layout="constrained")
plot_motions(X, np.where(kept, labels, -1), frames=(first, last), ax=ax)
ends = unpack_tracks(X)[0][:, last]
ax.plot(*ends[wandering].T, "o", mfc="none", mec="black", ms=9, mew=0.8)
ax.plot(*ends[~kept].T, "x", color="black", ms=6)
ax.set_title("rejected (crosses) and truly wandering (circles)")
plt.show()
