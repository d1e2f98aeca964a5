"""What a segmenter found, and why: a table of its motions and of their number."""

from __future__ import annotations

import html
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .._core.geometry.description_length import clip_geometry
from .._core.geometry.model_choice import ModelChoice, choose_model
from .._core.stream.joining import SURE
from .._utils.words import counted
from .reasons import ISOLATED, OUTLIER, TOO_SHORT

# Probability of a number of motions below which it is nearly as likely to be another.
NEAR_TIE = 0.6


@dataclass(frozen=True)
class MotionRecord:
    """One motion; the fields are those of :class:`SegmentationReport`."""

    label: int
    n_tracks: int
    share: float
    frames: tuple[int, ...]
    model: str | None
    residual: float
    residual_90: float
    description_lengths: dict[str, float]


@dataclass(frozen=True)
class CountRecord:
    """One number of motions; the fields are those of :class:`SegmentationReport`."""

    n_motions: int
    terms: tuple[float, float]
    total: float
    chosen: bool
    gainless_pair: tuple[int, int] | None
    probability: float
    verdict: str


@dataclass(frozen=True)
class WindowRecord:
    """A window of a long clip; the fields are those of :class:`SegmentationReport`."""

    frames: tuple[int, int]
    n_motions: int
    confidence: float


@dataclass(frozen=True)
class SegmentationReport:
    """What a segmenter found, and why.

    Made by :meth:`MotionSegmenter.report`; printed, it is a table.

    Parameters
    ----------
    motions : tuple of records
        For each motion: its ``label``; ``n_tracks``, and the ``share`` that they are of
        all tracks; ``frames``, the numbers of those in which some of them are seen;
        ``model``, the simplest that explains it: "affine", "homography" or
        "fundamental", or None if no frame pair sees eight of its tracks;
        ``residual`` and ``residual_90``, the median and the 90th percentile over its
        tracks of their distance from this model, in pixels (NaN without one); and
        ``description_lengths``, a dict of nats per observation by model, of which the
        least decides.
    counts : tuple of records
        For each number of motions that was tried, ``n_motions``: the two ``terms`` of
        its cost and their weighted sum, ``total``; whether it was ``chosen``;
        ``gainless_pair``, the labels (in ``candidate_labels_``) of two motions that
        gain too little from being apart, where it was passed over for that, or None;
        its ``probability`` (NaN where the rule gives none); and the ``verdict`` in
        words.
    n_tracks : int
    n_frames : int
    n_outliers : int
        Tracks labelled -1.
    n_judged : int
        Tracks that models and residuals are of: the landmarks.
    unassigned : dict of str to int
        How many tracks are labelled -1 for each reason: "outlier", "too short",
        "isolated" (see ``label_reasons_`` of :class:`MotionSegmenter`).
    term_names : (str, str)
        What the two terms are.
    weights : (float, float)
        Of the two terms in the total.
    windows : tuple of records
        Of a clip of more than 100 frames, in which no number of motions is tried for
        the whole, and ``counts`` is empty. For each window: ``frames``, its first and
        last; ``n_motions``, how many were found in it; ``confidence``, how probable it
        is that there are no fewer. Description lengths of a motion are then means over
        windows, weighted by its tracks, and residuals are of its tracks in each window
        that sees eight of them.

    Examples
    --------
    >>> from skmotionseg import MotionSegmenter
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> X, _ = make_rigid_motions(n_tracks=140, n_frames=8, random_state=0)
    >>> segmenter = MotionSegmenter(max_motions=4, random_state=0).fit(X)
    >>> report = segmenter.report(X)
    >>> [motion.model for motion in report.motions]
    ['fundamental', 'affine', 'fundamental']
    >>> [count.verdict for count in report.counts if count.chosen]
    ['chosen']
    """

    motions: tuple[MotionRecord, ...]
    counts: tuple[CountRecord, ...]
    n_tracks: int
    n_frames: int
    n_outliers: int
    n_judged: int
    unassigned: dict[str, int]
    term_names: tuple[str, str]
    weights: tuple[float, float]
    windows: tuple[WindowRecord, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """All numbers as plain dicts, lists and scalars, as JSON takes them.

        Returns
        -------
        dict
            The fields by name; records are dicts, tuples are lists, NaN is None.
        """
        return _plain(asdict(self))

    def motion_rows(self) -> list[dict[str, Any]]:
        """One flat row per motion, such as a ``pandas.DataFrame`` takes.

        Returns
        -------
        list of dict
            ``label``, ``n_tracks``, ``share``, ``n_frames``, ``model``, ``residual``
            and ``residual_90`` in pixels, and the description length per observation
            by each model.
        """
        rows = []
        for motion in self.motions:
            row = asdict(motion)
            lengths, frames = row.pop("description_lengths"), row.pop("frames")
            row["n_frames"] = len(frames)
            rows.append(row | {f"length_{name}": x for name, x in lengths.items()})
        return rows

    def count_rows(self) -> list[dict[str, Any]]:
        """One flat row per number of motions that was tried.

        Returns
        -------
        list of dict
            ``n_motions``, both terms by their name, ``total``, ``chosen``,
            ``probability`` and ``verdict``.
        """
        first, second = self.term_names
        return [
            {
                "n_motions": count.n_motions,
                first: count.terms[0],
                second: count.terms[1],
                "total": count.total,
                "chosen": count.chosen,
                "probability": count.probability,
                "verdict": count.verdict,
            }
            for count in self.counts
        ]

    def __str__(self) -> str:
        why = window_lines if self.windows else _count_lines
        parts = [_summary(self), _motion_lines(self), why(self)]
        return "\n\n".join(parts)

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"


def _plain(value):
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and np.isnan(value) else value


# ----------------------------------------------------------------------------- making


def make_report(segmenter, points, visibility):
    """The report of a fitted segmenter on the tracks that it was fitted to.

    Parameters
    ----------
    segmenter : MotionSegmenter
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)

    Returns
    -------
    SegmentationReport
    """
    labels, landmarks = segmenter.labels_, segmenter.landmarks_
    fitted = np.ix_(landmarks, segmenter._frames)
    geometry = clip_geometry(points[fitted], visibility[fitted])
    return SegmentationReport(
        motions=tuple(
            _motion_record(label, labels, visibility, geometry, landmarks)
            for label in range(segmenter.n_motions_)
        ),
        counts=tuple(_count_records(segmenter)),
        n_frames=visibility.shape[1],
        n_judged=len(landmarks),
        term_names=segmenter.cost_names_,
        weights=segmenter.cost_weights_,
        **_of_tracks(segmenter),
    )


def report_of_windows(segmenter, clip):
    """The report of a segmenter that was fitted to a long clip.

    Parameters
    ----------
    segmenter : MotionSegmenter
    clip : LongClip
        Of the tracks that it was fitted to.

    Returns
    -------
    SegmentationReport
    """
    labels, n_motions = segmenter.labels_, segmenter.n_motions_
    frames = np.zeros((n_motions, clip.n_frames), dtype=bool)
    chosen: list[list[ModelChoice]] = [[] for _ in range(n_motions)]
    judged = np.zeros(len(labels), dtype=bool)
    for part in clip.parts:
        points, seen = clip.window(part)
        geometry, own = clip_geometry(points, seen), labels[part.tracks]
        judged[part.tracks] = True
        for label in np.unique(own[own >= 0]):
            chosen[label].append(choose_model(geometry, np.flatnonzero(own == label)))
            frames[label, part.start : part.stop] |= seen[own == label].any(axis=0)
    found = zip(segmenter.window_counts_, segmenter.window_confidences_, strict=True)
    return SegmentationReport(
        motions=tuple(
            _record(
                label, labels == label, clip.frames[frames[label]], _mean(chosen[label])
            )
            for label in range(n_motions)
        ),
        counts=(),
        n_frames=clip.length,
        n_judged=int(judged.sum()),
        term_names=("", ""),
        weights=(0.0, 0.0),
        windows=tuple(
            WindowRecord((int(first), int(last)), int(count), float(sure))
            for (first, last), (count, sure) in zip(
                segmenter.windows_, found, strict=True
            )
        ),
        **_of_tracks(segmenter),
    )


def _of_tracks(segmenter):
    """What a report says of tracks in all, by its name there."""
    labels, reasons = segmenter.labels_, segmenter.label_reasons_
    return {
        "n_tracks": len(labels),
        "n_outliers": int((labels < 0).sum()),
        "unassigned": {
            reason: int((reasons == reason).sum())
            for reason in (OUTLIER, TOO_SHORT, ISOLATED)
        },
    }


def _motion_record(label, labels, visibility, geometry, landmarks):
    members = labels == label
    found = choose_model(geometry, np.flatnonzero(members[landmarks]))
    return _record(
        label, members, np.flatnonzero(visibility[members].any(axis=0)), found
    )


def _record(label, members, frames, found):
    residuals = found.residuals if len(found.residuals) else [np.nan]
    return MotionRecord(
        label=label,
        n_tracks=int(members.sum()),
        share=float(members.mean()),
        frames=tuple(frames.tolist()),
        model=found.model,
        residual=float(np.median(residuals)),
        residual_90=float(np.percentile(residuals, 90)),
        description_lengths=found.lengths,
    )


def _mean(choices):
    """One choice of a model from those of windows: of the least mean length."""
    choices = [each for each in choices if each.model is not None]
    if not choices:
        return ModelChoice(None, {}, np.zeros(0))
    weights = [len(each.residuals) for each in choices]
    lengths = {
        name: float(
            np.average([each.lengths[name] for each in choices], weights=weights)
        )
        for name in choices[0].lengths
    }
    residuals = np.concatenate([each.residuals for each in choices])
    return ModelChoice(min(lengths, key=lambda name: lengths[name]), lengths, residuals)


def _count_records(segmenter):
    counts, costs, best = segmenter.counts_, segmenter.costs_, segmenter.best_index_
    tolerance = segmenter.cost_tolerance_
    for position, (count, cost) in enumerate(zip(counts, costs, strict=True)):
        labels = segmenter.gainless_pairs_[position].tolist()
        pair = None if min(labels) < 0 else tuple(labels)
        rise = cost[2] - costs[best, 2]
        odds = segmenter.log_odds_[position]
        verdict = _verdict(pair, odds, rise, tolerance, count < counts[best])
        if position == best:
            verdict = _verdict_of_chosen(pair, len(counts))
        yield CountRecord(
            n_motions=int(count),
            terms=(float(cost[0]), float(cost[1])),
            total=float(cost[2]),
            chosen=position == best,
            gainless_pair=pair,
            probability=float(segmenter.count_probabilities_[position]),
            verdict=verdict,
        )


def _verdict(gainless_pair, log_odds, rise, tolerance, is_fewer):
    """Why a count was not taken."""
    if gainless_pair is not None:
        first, second = gainless_pair
        if np.isnan(log_odds):
            return f"motions {first} and {second} gain too little"
        return f"motions {first} and {second} are one ({_percent(-log_odds)})"
    if rise > tolerance:
        return f"cost higher by {rise:.2g}"
    return f"same cost, but {'fewer' if is_fewer else 'more'} motions"


def _percent(log_odds):
    """A probability in per cent, never 100."""
    return f"{min(100 / (1 + np.exp(-log_odds)), 99):.0f} %"


def _verdict_of_chosen(gainless_pair, n_counts):
    if n_counts == 1:
        return "chosen: no other was tried"
    return "chosen" if gainless_pair is None else "chosen: the first, as none gains"


# --------------------------------------------------------------------------- printing


def _summary(report):
    n_motions = len(report.motions)
    return (
        f"{counted(n_motions, 'motion')} in {counted(report.n_tracks, 'track')}, "
        f"{_unassigned(report)}, {counted(report.n_frames, 'frame')}"
    )


def _unassigned(report):
    """``3 unassigned (2 outliers, 1 isolated)``."""
    plural = {OUTLIER: "outliers"}
    reasons = [
        f"{n} {reason if n == 1 else plural.get(reason, reason)}"
        for reason, n in report.unassigned.items()
        if n
    ]
    return f"{report.n_outliers} unassigned" + (
        f" ({', '.join(reasons)})" if reasons else ""
    )


def _motion_lines(report):
    header = ("motion", "tracks", "share", "frames", "explained by", "residual", "90 %")
    rows = [
        (
            str(motion.label),
            str(motion.n_tracks),
            f"{motion.share:.1%}",
            f"{len(motion.frames)} of {report.n_frames}",
            motion.model or "too few",
            pixels(motion.residual),
            pixels(motion.residual_90),
        )
        for motion in report.motions
    ]
    if report.n_outliers:
        share = f"{report.n_outliers / report.n_tracks:.1%}"
        rows.append(("none", str(report.n_outliers), share, "", "", "", ""))
    lines = _table([header], rows, "rrrrlrr")
    if report.n_judged < report.n_tracks and not report.windows:
        lines += f"\nModels and residuals are those of {report.n_judged} landmarks."
    return lines


def pixels(residual):
    """``0.52 px``, or a dash where there is none."""
    return "-" if np.isnan(residual) else f"{residual:.2f} px"


def _count_lines(report):
    names = [_halves(name) for name in report.term_names]
    header = [
        ("", *(first for first, _ in names), "", ""),
        ("motions", *(last for _, last in names), "total", ""),
    ]
    rows = [
        (
            str(count.n_motions),
            *(f"{term:.4f}" for term in count.terms),
            f"{count.total:.4f}",
            count.verdict,
        )
        for count in report.counts
    ]
    lines = [_table(header, rows, "rrrrl"), _formula(report), how_sure(report)]
    return "\n".join(line for line in lines if line)


def window_lines(report):
    """How many windows have found how many motions."""
    header = ("motions found", "windows", "sure", "frames")
    rows = []
    for count in sorted({each.n_motions for each in report.windows}):
        own = [each for each in report.windows if each.n_motions == count]
        sure = sum(each.confidence >= SURE for each in own)
        first, last = own[0].frames[0], own[-1].frames[1]
        rows.append((str(count), str(len(own)), str(sure), f"{first} to {last}"))
    what = (
        f"{len(report.windows)} windows, joined by their tracks and places. Sure: no "
        f"fewer motions with\n{100 * SURE:.0f} % or more. Models and residuals are "
        "those in windows."
    )
    return "\n".join([_table([header], rows, "rrrr"), what])


def how_sure(report):
    """How likely the number of motions is, and the next one; "" if unknown.

    The number that is chosen is the largest that is reached more likely than not. Fewer
    may be likelier than just as many, and then this is said. The next one is left out
    if it has no whole percent.
    """
    if len(report.counts) == 1 or np.isnan(report.counts[0].probability):
        return ""
    (chosen,) = (each for each in report.counts if each.chosen)
    others = (each for each in report.counts if not each.chosen)
    following = max(others, key=lambda each: each.probability)
    likely, less = (
        f"{each.n_motions} with {100 * each.probability:.0f} %"
        for each in (chosen, following)
    )
    tie, other = "a near tie" if chosen.probability < NEAR_TIE else "", "next,"
    if following.probability > chosen.probability:
        reached = sum(
            each.probability
            for each in report.counts
            if each.n_motions >= chosen.n_motions
        )
        tie += f": {chosen.n_motions} or more with {100 * reached:.0f} %"
        other = "likelier alone:"
    words = f"Number of motions: {likely}{tie and f' ({tie})'}"
    return f"{words}." if following.probability < 0.005 else f"{words}; {other} {less}."


def _halves(name):
    """A name on two lines, parted where they are of most equal length."""
    words = name.split()
    if len(words) == 1:
        return "", name
    parts = [(" ".join(words[:i]), " ".join(words[i:])) for i in range(1, len(words))]
    return min(parts, key=lambda both: max(map(len, both)))


def _formula(report):
    (first, second), (name, other) = report.weights, report.term_names
    first = "" if first == 1 else f"{first:g} x "
    sign = "-" if second < 0 else "+"
    second = "" if abs(second) == 1 else f"{abs(second):g} x "
    return f"total = {first}{name} {sign} {second}{other}"


def _table(header, rows, alignment):
    """Lines of columns, two spaces apart; "l" or "r" for each."""
    lines = [*header, *rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    put = {"l": str.ljust, "r": str.rjust}
    laid = [
        "  ".join(
            put[side](cell, width)
            for cell, width, side in zip(line, widths, alignment, strict=True)
        ).rstrip()
        for line in lines
    ]
    rule = "-" * max(map(len, laid))
    return "\n".join([*laid[: len(header)], rule, *laid[len(header) :]])
