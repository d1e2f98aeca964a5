"""
How many motions? Reading the costs
===================================

With ``n_motions="auto"``, each number of motions from ``min_motions`` to
``max_motions`` is tried. ``costs_`` holds the costs of the best partition for each
number: a cost of the affinities that it cuts, the length of the description of its
tracks, in nats, and their weighted sum. ``cost_names_`` says which costs these are.

The first increases with the number of motions, and the second decreases as long as more
motions describe the tracks better, so the total has a minimum in between.
"""

import matplotlib.pyplot as plt
import numpy as np

from skmotionseg import MotionSegmenter
from skmotionseg.datasets import make_rigid_motions

X, y = make_rigid_motions(n_tracks=300, n_frames=12, n_motions=4, random_state=3)
segmenter = MotionSegmenter(max_motions=8, random_state=0).fit(X)
weights = segmenter.cost_weights_
names = [
    name if weight == 1 else f"{weight:g} x {name}"
    for weight, name in zip(weights, segmenter.cost_names_, strict=True)
]
print(f"motions   {names[0]:>22s}   {names[1]:>22s}   {'total':>7s}")
for count, costs in zip(segmenter.counts_, segmenter.costs_, strict=True):
    first, second = costs[:2] * weights
    print(f"{count:7d}   {first:22.2f}   {second:22.2f}   {costs[2]:7.2f}")
print(f"chosen: {segmenter.n_motions_} (true: {len(set(y))})")

# %%
# If two totals are close, both partitions may be of interest:
# ``candidate_labels_[i]`` is the best partition into ``counts_[i]`` motions. The number
# of the lowest total is not chosen if two of its motions gain too little from being
# separate.

first, second = segmenter.costs_[:, :2].T * np.reshape(weights, (2, 1))
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
ax.plot(segmenter.counts_, segmenter.costs_[:, 2], "o-", color="black", label="total")
ax.plot(segmenter.counts_, second, "s--", color="#0072b2", label=names[1])
ax.plot(segmenter.counts_, first, "^:", color="#d55e00", label=names[0])
ax.axvline(segmenter.n_motions_, color="0.8", lw=8, zorder=0, label="chosen")
ax.set(xlabel="number of motions", ylabel="nats")
ax.legend(frameon=False)
plt.show()
