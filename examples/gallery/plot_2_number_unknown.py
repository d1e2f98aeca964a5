"""
How many motions? Reading the costs
===================================

With ``n_motions="auto"``, each number of motions from ``min_motions`` to
``max_motions`` is tried. ``costs_`` holds the costs of the best partition for each
number: its normalised cut, its description length per observation, in nats, and the sum
of the two, with a weight of 0.3 for the cut.

The cut grows with the number of motions, and the description length decreases, so the
total has a minimum in between.
"""

import matplotlib.pyplot as plt

from skmotionseg import MotionSegmenter
from skmotionseg.datasets import make_rigid_motions

X, y = make_rigid_motions(n_tracks=300, n_frames=12, n_motions=4, random_state=3)
segmenter = MotionSegmenter(max_motions=8, random_state=0).fit(X)
print("motions      cut   nats per observation   total")
for count, (cut, nats, total) in zip(segmenter.counts_, segmenter.costs_, strict=True):
    print(f"{count:7d}   {cut:6.2f}   {nats:20.2f}   {total:5.2f}")
print(f"chosen: {segmenter.n_motions_} (true: {len(set(y))})")

# %%
# If two totals are close, both partitions may be of interest:
# ``candidate_labels_[i]`` is the best partition into ``counts_[i]`` motions. The number
# of the lowest total is not chosen if two of its motions gain too little from being
# separate.

cut, nats, total = segmenter.costs_.T
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
ax.plot(segmenter.counts_, total, "o-", color="black", label="total")
ax.plot(segmenter.counts_, nats, "s--", color="#0072b2", label="description length")
ax.plot(segmenter.counts_, total - nats, "^:", color="#d55e00", label="0.3 x cut")
ax.axvline(segmenter.n_motions_, color="0.8", lw=8, zorder=0, label="chosen")
ax.set(xlabel="number of motions", ylabel="nats per observation")
ax.legend(frameon=False)
plt.show()
