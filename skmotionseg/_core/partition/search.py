"""Choose among many partitions of the tracks by description length and graph cut."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import expit

from ..geometry.camera import REFERENCE_WIDTH, share_of_width
from ..geometry.description_length import clip_geometry
from ..geometry.windows import FEWEST_SEEN, Windows, reaching_frames
from ..graph.cuts import own_shares
from ..graph.neighbourhood import strongest
from ..graph.spectral import ViewGraph, connected_tracks
from ..labels import canonical_labels, groups_of, nearest_votes_in_each
from .clip import OVERSEGMENTATION, Clip
from .cost import COST_NAMES, COST_WEIGHTS, Cost
from .frame_pair_partitions import frame_pair_partitions
from .motions import Explanation, fit_motions, inliers, usual
from .outliers import RigidOutliers
from .photograph_partitions import are_photographs, photograph_partitions
from .rigid_partitions import rigid_partitions
from .rigid_search import NATS_OF_LINKS, RigidSearch
from .two_view_partitions import (
    TWO_VIEW_COST_NAMES,
    ByDensity,
    two_view_partitions,
)

# Exponents of the epsilon-neighbourhood: candidates come from all, and the last is the
# graph on which partitions are cut and over-segmented.
SPARSITIES = (4.0, 8.0)
# Links of a track, by the simplest motion model, that tell motions apart: of a thousand
# tracks the graph has up to 50 of each, and a small thing may have fewer tracks. On 32
# dense simulated scenes, the error with the number known falls from 1.6 to 0.6 %.
LINKS = 24
# Tracks, and the share of them that some window sees often enough, below which rigid
# motion over windows is not asked. By it, two motions among 12 to 39 tracks are found
# in 53 % of simulated clips, and one is never parted; by frame pairs, hardly ever.
FEWEST_FOR_RIGID = 12
SHARE_IN_WINDOWS = 0.5
# Share of the tracks from which on outliers are so many that motions are searched again
# without them, and how often at most, as those that are left may make a motion of their
# own again. In 112 simulated scenes, half of which have outliers, the number of motions
# is right in 87 % instead of 82 % where only sure ones were left out, once.
MANY_OUTLIERS = 0.03
MOST_SEARCHES_AGAIN = 3
# Pixels, of a video 640 pixels wide, that half of the tracks are from their motions,
# above which these explain little: in simulated and real clips it is 0.03 to 0.6, where
# 70 % of the tracks are walks, over 2, and of points at random over 200.
MOST_UNEXPLAINED = 1.5


@dataclass(frozen=True)
class PartitionSearch:
    """The best partition for each number of motions, and the best of all.

    Attributes
    ----------
    counts : ndarray of int, shape (n_counts,)
    costs : ndarray of shape (n_counts, 3)
        The terms that ``cost_names`` names, and their weighted total: by rigid motion,
        the share of the links that go to other motions, and nats per track; by frame
        pairs, the normalised cut, summed over the views, and the description length per
        observation; between two images, nats per track of labels and motions, and of
        places; by the graph, what the selector compares. By rigid motion, the total
        does not choose the number of motions: it is the largest of which a partition is
        found whose motions are all likelier different than one.
    labels : ndarray of int, shape (n_counts, n)
        -1 for tracks without affinity to another.
    best : int
        Position of the count that was chosen.
    shares : ndarray of shape (n,)
        Of each track's affinity, what is to others of its motion in the chosen one.
        Between two images, the probability that it has the label.
    explanation : Explanation, ByDensity or None
        Of the chosen partition, if outliers are to be rejected.
    gainless : ndarray of int, shape (n_counts, 2), optional
        Two motions that gain too little from being apart, for each count that was
        passed over for it; -1 for others.
    log_odds : ndarray of shape (n_counts,), optional
        Of the two least different motions of each partition being two; NaN where the
        search does not say.
    cost_names : (str, str)
        Names of the two terms of the costs.
    cost_weights : (float, float)
        Their weights in the total.
    cost_tolerance : float
        Totals that differ by no more are considered equal.
    outliers : ndarray of bool, shape (n,), optional
        Tracks that have no motion in the chosen partition, though they have a label;
        None if the explanation tells them.
    distinct : ndarray of shape (n_motions,), optional
        Probability of each motion of the chosen partition of not being part of a
        larger one, where the number of motions was open; None if nothing is known.
    unexplained : float
        How far, in pixels, half of the tracks are at least from the rigid motion that
        they are assigned to, where that is so far that it hardly explains them; else 0.
    """

    counts: np.ndarray
    costs: np.ndarray
    labels: np.ndarray
    best: int
    shares: np.ndarray
    explanation: Explanation | ByDensity | None = None
    gainless: np.ndarray | None = None
    log_odds: np.ndarray | None = None
    cost_names: tuple[str, str] = COST_NAMES
    cost_weights: tuple[float, float] = COST_WEIGHTS
    cost_tolerance: float = 1e-9
    outliers: np.ndarray | None = None
    distinct: np.ndarray | None = None
    unexplained: float = 0.0


def search_partitions(
    points,
    visibility,
    views,
    counts,
    sparsities,
    cluster,
    reject_outliers=True,
    stratified=False,
    seed=0,
    focal_length=None,
):
    """Find the best partition for each of several numbers of motions.

    Candidates are spectral clusterings for several sparsities and over-segments
    that are merged step by step. Where tracks are seen in several frames, the judge is
    rigid motion over windows of frames (see :mod:`.rigid_partitions`), and where
    outliers are many, motions are searched again without them; of few or short tracks,
    it is fundamental matrices of frame pairs and the cut of the graph (see
    :mod:`.frame_pair_partitions`).
    Between two images, where most tracks may be mismatches, motions are searched for
    one by one, without the graph (see :mod:`.two_view_search`), and of photographs
    between each two of them (see :mod:`.photograph_partitions`).

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    views : ndarray of shape (n_views, n_tracks, n_tracks)
        Affinities before sparsification, the simplest model first.
    counts : ndarray of int, shape (n_counts,)
        Ascending; none above the tracks with an affinity to another.
    sparsities : sequence of float or None
        Exponents of the epsilon-neighbourhood to try; None keeps all affinities.
    cluster : callable
        ``(graph, n_clusters) -> labels``: clusters of a :class:`ViewGraph`, -1 for
        tracks that meet no other.
    reject_outliers : bool, default=True
    stratified : bool, default=False
        Whether the tracks are landmarks, as many from each over-segment of the video.
    seed : int, default=0
        Of the search between two images.
    focal_length : float, optional
        Of the camera, pixels; if not given, it is found where rigid motions are fitted.

    Returns
    -------
    PartitionSearch
    """
    connected = connected_tracks(views)
    some = points[connected], visibility[connected]
    between = _between_images(*some, counts, np.random.RandomState(seed))
    if between is not None:
        return _by_images(between, connected, len(points), reject_outliers)
    views = views[:, connected[:, None], connected]
    clip = Clip(*some, views, sparsities, cluster, stratified)
    found, explanation = _by_motions(clip, counts, focal_length)
    if not reject_outliers:
        explanation = None
    return _of_all_tracks(found, clip, connected, len(points), explanation)


def _of_all_tracks(found, clip, connected, n_tracks, explanation):
    """What was found in the tracks that are connected, for all tracks."""
    best, (names, weights) = found.best, found.costs
    labels = {count: best[count][1] for count in sorted(best)}
    shares = own_shares(clip.sparse[-1], labels[found.chosen])
    return PartitionSearch(
        np.array(list(labels)),
        np.array([best[count][0] for count in labels]),
        _put(connected, np.stack(list(labels.values())), n_tracks, -1),
        list(labels).index(found.chosen),
        _put(connected, shares, n_tracks, 0.0),
        explanation,
        np.array([found.gainless.get(count, (-1, -1)) for count in labels]),
        np.array([found.log_odds.get(count, np.nan) for count in labels]),
        names,
        weights,
        distinct=found.distinct,
        unexplained=found.unexplained,
    )


def _between_images(points, visibility, counts, rng):
    """What two images tell, or photographs two at a time; None of a video."""
    if points.shape[1] == 2:
        return two_view_partitions(clip_geometry(points, visibility), counts, rng)
    if are_photographs(points, visibility):
        return photograph_partitions(points, visibility, counts, rng)
    return None


def _by_images(found, connected, n_tracks, reject_outliers):
    """What a search between images has found in the tracks that are connected."""
    labels = np.stack([labels for _, labels in found.best.values()])
    nobody = np.full((len(labels), 2), -1)
    return PartitionSearch(
        np.array(list(found.best)),
        np.array([cost for cost, _ in found.best.values()]),
        _put(connected, labels, n_tracks, -1),
        list(found.best).index(found.chosen),
        _put(connected, found.probabilities, n_tracks, 0.0),
        found.explanation if reject_outliers else None,
        nobody,
        _rising_odds(found),
        TWO_VIEW_COST_NAMES,
        (1.0, 1.0),
        outliers=_put(connected, found.outliers, n_tracks, False)
        if reject_outliers
        else None,
    )


def _rising_odds(found):
    """Log odds of each number; NaN for the fewest, and where there is one alone."""
    odds = [found.log_odds.get(count, np.nan) for count in found.best]
    return np.array([np.nan, *odds[1:]])


class _Found(NamedTuple):
    """What a judge makes of a clip.

    Attributes
    ----------
    best : dict of int to (Cost, ndarray)
        Cost and labels of the best partition for each number of motions.
    chosen : int
    gainless : dict of int to (int, int)
        Two motions that are likely one, for the numbers passed over for it.
    log_odds : dict of int to float
        Of the two least different motions of a partition.
    costs : tuple
        Names of the terms of a cost, and their weights.
    rigid : (Windows, list of RigidMotion) or None
        The rigid motions of the chosen partition, where these were compared.
    distinct : ndarray of shape (n_motions,) or None
    unexplained : float
        As in :class:`PartitionSearch`.
    """

    best: dict[int, tuple[Cost, np.ndarray]]
    chosen: int
    gainless: dict[int, tuple[int, int]]
    log_odds: dict[int, float]
    costs: tuple = (COST_NAMES, COST_WEIGHTS)
    rigid: tuple | None = None
    distinct: np.ndarray | None = None
    unexplained: float = 0.0


def _by_motions(clip, counts, focal_length):
    """The best partitions by the judge that fits a clip, and what explains its tracks.

    Outliers make motions of their own, and hide those of others. So where there are
    many, rigid motions are searched again without them: from new over-segments, and
    from what was found.
    """
    found = _by_rigid_motion(clip, counts, focal_length)
    if found is None:
        best, chosen, gainless = frame_pair_partitions(clip, counts)
        found = _Found(best, chosen, gainless, {})
        return found, _explain(clip, found)
    part, tracks = clip, np.arange(len(clip.points))
    explanation = _explain(part, found)
    for _ in range(MOST_SEARCHES_AGAIN):
        kept = _kept(part, explanation, found.best[found.chosen][1])
        if len(kept) >= (1 - MANY_OUTLIERS) * len(part.points):
            break
        starts = [canonical_labels(labels[kept]) for _, labels in found.best.values()]
        rest = part.of(kept)
        again = _by_rigid_motion(rest, counts, focal_length, starts)
        if again is None:
            break
        found, part, tracks = again, rest, tracks[kept]
        explanation = _explain(part, found)
    if part is clip:
        return found, explanation
    explanation = explanation.among(clip.points, clip.visibility)
    return _with_nearest(found, tracks, clip.affinity), explanation


def _kept(clip, explanation, labels):
    """Positions of the tracks that are no outliers, nor linked to outliers only."""
    doubtful = explanation.doubtful(clip.points, clip.visibility, labels)
    kept = np.flatnonzero(~doubtful)
    return kept[connected_tracks(clip.views[:, kept[:, None], kept])]


def _with_nearest(found, tracks, affinity):
    """What was found in some tracks, with the others in the motions of their nearest.

    A track that shares no preference with these is in the largest motion.
    """
    costs, found_labels = zip(*found.best.values(), strict=True)
    partitions = np.stack(found_labels)
    others = np.setdiff1d(np.arange(len(affinity)), tracks)
    to_tracks = affinity[np.ix_(others, tracks)]
    nearest, _ = nearest_votes_in_each(to_tracks, partitions)
    largest = [[np.bincount(labels).argmax()] for labels in partitions]
    labels = _put(tracks, partitions, len(affinity), -1)
    labels[:, others] = np.where(nearest >= 0, nearest, largest)
    best = zip(costs, labels, strict=True)
    return found._replace(best=dict(zip(found.best, best, strict=True)))


def _by_rigid_motion(clip, counts, focal_length=None, starts=()):
    """The best partitions by rigid motion over windows; None where it tells little.

    Starts are partitions (n,) that are tried beside spectral clusterings.
    """
    views = clip.sparse[-1]
    affinity = views.sum(axis=0)
    windows = None if counts[-1] == 1 else _windows(clip, affinity)
    if windows is None:
        return None
    most = max(OVERSEGMENTATION, int(counts[0]) + 2)
    graphs = list(clip.graphs(most))
    if not graphs:
        return None
    few = strongest(views[0], LINKS)
    of_few = ViewGraph.from_affinities(few[None], most)

    share = focal_length and share_of_width(focal_length, windows.size)
    search = RigidSearch(windows, affinity, few, share)

    def candidates(n_motions):
        found = [
            clip.clusters(graph, n_motions)
            for graph in (*graphs, of_few)
            if 1 < n_motions <= graph.n_leading
        ]
        return found + [some for some in starts if some.max() + 1 == n_motions]

    def finer(n_groups):
        sparsest = next(clip.graphs(n_groups), None)
        return None if sparsest is None else clip.over_segments(sparsest)

    found = rigid_partitions(
        search, clip.over_segments(graphs[0]), counts, candidates, clip.bisect, finer
    )
    return None if found is None else _rigid_costs(search, found)


def _rigid_costs(search, found):
    """Costs per track of partitions by rigid motion, and which counts are not it."""
    best: dict[int, tuple[Cost, np.ndarray]] = {}
    gainless, log_odds = {}, {}
    for count, step in found.steps.items():
        cut, nats = search.terms(step.labels, step.motions)
        best[count] = Cost(cut, nats, NATS_OF_LINKS * cut + nats), step.labels
        if step.pair is not None:
            log_odds[count] = step.log_odds
            if count > found.chosen:
                gainless[count] = step.pair
    costs = ("links to other motions", "nats per track"), (NATS_OF_LINKS, 1.0)
    step = found.steps[found.chosen]
    rigid = search.windows, step.motions
    distinct = _distinct(step) if len(found.steps) > 1 else None
    left = _unexplained(search.windows, step)
    return _Found(best, found.chosen, gainless, log_odds, costs, rigid, distinct, left)


def _unexplained(windows, step):
    """As in :class:`PartitionSearch`."""
    own = windows.own_deviations(step.motions, groups_of(step.labels), relative=False)
    left = float(np.median(own)) * windows.pixels
    return left * windows.size / REFERENCE_WIDTH if left > MOST_UNEXPLAINED else 0.0


def _distinct(step):
    """How likely each motion of a step is not part of a larger one: (n_motions,)."""
    probabilities = np.ones(step.n_motions)
    if step.pair is not None:
        pair = np.array(step.pair)
        smaller = pair[np.bincount(step.labels)[pair].argmin()]
        probabilities[smaller] = expit(step.log_odds)
    return probabilities


def count_probabilities(counts, log_odds):
    """How likely each number of motions is.

    Parameters
    ----------
    counts : ndarray of int, shape (n_counts,)
        Ascending.
    log_odds : ndarray of shape (n_counts,)
        Of the two least different motions of each partition being two.

    Returns
    -------
    ndarray of shape (n_counts,)
        There are at least as many motions as in any partition whose motions are all
        different, so the probability of a number is that of it or more being different
        less that of more. NaN where any log odds but those of the first are NaN.
    """
    if len(counts) == 1:
        return np.ones(1)
    apart = expit(log_odds)
    apart[0] = 1
    if np.isnan(apart).any():
        return np.full(len(counts), np.nan)
    at_least = np.maximum.accumulate(apart[::-1])[::-1]
    return at_least - np.append(at_least[1:], 0)


def _windows(clip, affinity):
    """Windows in which rigid motions are fitted; None where they would tell little."""
    n_tracks, n_frames = clip.visibility.shape
    if n_frames < FEWEST_SEEN or n_tracks < FEWEST_FOR_RIGID:
        return None
    frames = reaching_frames(clip.visibility, affinity)
    windows = Windows(clip.points, clip.visibility, frames=frames)
    enough = np.mean(windows.freedom.any(axis=1)) >= SHARE_IN_WINDOWS
    return windows if enough else None


def _put(positions, values, n, other):
    """Values (..., n_positions) in their places among n, another value elsewhere."""
    everywhere = np.full((*values.shape[:-1], n), other)
    everywhere[..., positions] = values
    return everywhere


def _explain(clip, found):
    """Motions of the chosen partition, and those of over-segments that it has lost."""
    labels = found.best[found.chosen][1]
    motions = fit_motions(clip.geometry, labels, clip.affinity)
    lost = ~inliers(motions, clip.distances(motions)).any(axis=0)
    spare = motions[:0]
    segments = _segments_of(clip, lost)
    if segments.max() >= 0:
        spare = fit_motions(clip.geometry, segments, clip.affinity)
        spare = spare[usual(spare.noise, motions.noise[labels])]
    odd = None if found.rigid is None else RigidOutliers.of(*found.rigid)
    return Explanation(motions, spare, odd)


def _segments_of(clip, some):
    """Labels of the over-segments most of whose tracks are some given ones; else -1."""
    if not some.any():
        return np.full(len(some), -1)
    graph = ViewGraph.from_affinities(
        clip.sparse[-1], min(OVERSEGMENTATION, len(clip.points))
    )
    labels = np.zeros(len(clip.points), dtype=int)
    if graph.n_leading > 1:
        labels = clip.over_segments(graph)
    mostly = 2 * np.bincount(labels, weights=some) > np.bincount(labels)
    return canonical_labels(np.where(mostly[labels], labels, -1))
