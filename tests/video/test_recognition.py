"""Things that were out of view are known again by how they look."""

from __future__ import annotations

from functools import partial
from itertools import permutations

import numpy as np
import pytest
from helpers.pictures import plaster
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad

from skmotionseg import pack_tracks
from skmotionseg._core.geometry.tracks import tracks_by_frame
from skmotionseg.video import _recognition as recognition
from skmotionseg.video import find_objects
from skmotionseg.video._recognition import (
    EVERY,
    FRAMES_AFTER,
    FRAMES_BEFORE,
    MOST_MATCHES,
    Look,
    known_again,
    log_odds,
    match_evidence,
    overlap,
)

cv2 = pytest.importorskip("cv2", reason="needs opencv-python-headless")

HEIGHT, WIDTH, SIDE = 120, 160, 48
RED, GREEN = (60, 70, 190), (70, 170, 60)


def coloured(rng, shape, colour):
    """A picture with texture of a colour, and of some others."""
    stains = plaster(rng, shape)[..., None] > 150
    grey = plaster(rng, shape)[..., None] / 255.0
    return np.uint8(np.where(stains, 255 - np.array(colour), colour) * grey)


class Film:
    """A wall, and things that pass before it, with their tracks.

    Parameters
    ----------
    n_frames : int
    visits : list of (first frame, last frame, thing, height)
        Who passes from left to right, and when, at rows of the picture; each visit is a
        label of its own.
    """

    def __init__(self, n_frames, visits):
        rng = np.random.default_rng(0)
        wall = coloured(rng, (HEIGHT, WIDTH), (120, 120, 120))
        self.pictures = [
            coloured(rng, (SIDE, SIDE), RED),
            coloured(rng, (SIDE, SIDE), GREEN),
        ]
        self.frames = [wall.copy() for _ in range(n_frames)]
        grid = np.mgrid[4:HEIGHT:8, 4:WIDTH:8].reshape(2, -1).T[:, ::-1]
        own = np.mgrid[3:SIDE:5, 3:SIDE:5].reshape(2, -1).T[:, ::-1]
        points = [np.repeat(grid[:, None].astype(float), n_frames, axis=1)]
        labels = [np.zeros(len(grid), dtype=int)]
        for label, (first, last, thing, row) in enumerate(visits, 1):
            xs = np.linspace(0, WIDTH - SIDE, last - first + 1)
            where = np.full((len(own), n_frames, 2), np.nan)
            for frame, x in zip(range(first, last + 1), xs, strict=True):
                self._show(frame, thing, round(x), row)
                where[:, frame] = own + np.array([round(x), row])
                hidden = (abs(grid - [x + SIDE / 2, row + SIDE / 2]) <= SIDE / 2).all(1)
                points[0][hidden, frame] = np.nan
            points.append(where)
            labels.append(np.full(len(own), label))
        self.points, self.things = np.concatenate(points), np.concatenate(labels)
        self.seen = partial(
            tracks_by_frame, self.points, np.isfinite(self.points[..., 0])
        )

    def _show(self, frame, thing, x, row):
        light = 0.9 + 0.2 * frame / len(self.frames)  # brighter with time
        picture = np.clip(self.pictures[thing] * light, 0, 255).astype(np.uint8)
        self.frames[frame][row : row + SIDE, x : x + SIDE] = picture

    def known_again(self, source=None):
        """The label that each visit gets."""
        source = self.frames if source is None else source
        size = WIDTH, HEIGHT
        found = known_again(source, self.seen, self.things, size)
        assert_array_equal(found[self.things == 0], 0)
        return [
            int(np.unique(found[self.things == k])[0])
            for k in range(1, self.things.max() + 1)
        ]


def unread():
    raise AssertionError("a frame was read")
    yield


def test_the_same_thing_is_known_after_a_long_time():
    assert Film(100, [(0, 29, 0, 8), (70, 99, 0, 60)]).known_again() == [1, 1]


def test_another_thing_is_not():
    assert Film(100, [(0, 29, 0, 8), (70, 99, 1, 60)]).known_again() == [1, 2]


def test_each_of_two_is_known_and_so_is_what_comes_a_third_time():
    visits = [(0, 24, 0, 8), (0, 24, 1, 64), (50, 74, 1, 8), (55, 79, 0, 64)]
    film = Film(125, [*visits, (100, 124, 0, 8)])
    assert film.known_again() == [1, 2, 2, 1, 1]


@pytest.mark.parametrize("scores", [*permutations([5.0, 6.0, 7.0])])
def test_whichever_two_are_likeliest_all_three_are_one(scores):
    pairs = [(1, 2), (1, 3), (2, 3)]
    found = dict(zip(pairs, scores, strict=True))
    visits = 9 * np.eye(3, dtype=int)  # one after the other
    counts = np.concatenate([np.zeros((1, 3), dtype=int), visits])
    assert_array_equal(recognition._joined(found, counts), [0, 1, 1, 1])
    found[1, 3] = -20.0  # it is known by what it was in between
    assert_array_equal(recognition._joined(found, counts), [0, 1, 1, 1])


def test_what_looks_the_same_but_is_seen_together_is_two():
    film = Film(60, [(0, 40, 0, 8), (10, 50, 0, 64)])
    assert film.known_again(unread()) == [1, 2]


def test_of_two_that_look_the_same_one_was_there_before():
    film = Film(100, [(0, 29, 0, 8), (60, 90, 0, 8), (60, 90, 0, 64)])
    found = film.known_again()
    assert found[0] == 1 and found.count(1) == 2


def test_frames_are_read_only_where_something_may_have_come_back():
    assert Film(30, [(0, 29, 0, 8), (0, 29, 1, 64)]).known_again(unread()) == [1, 2]
    assert Film(30, []).known_again(unread()) == []


def test_a_source_that_is_none_is_named_before_any_work(tmp_path, monkeypatch):
    def at_work(*_):
        raise AssertionError("things were looked for")

    monkeypatch.setattr("skmotionseg.video._objects._by_shot", at_work)
    X, size = np.ones((3, 8)), {"width": 20, "height": 10}
    for source, error in ((tmp_path / "nope.mp4", FileNotFoundError), (7, TypeError)):
        with pytest.raises(error, match=r"no video or folder|the path of a video"):
            find_objects(X, [0, 0, 1], **size, source=source)


def test_progress_counts_all_frames():
    film, done = Film(70, [(0, 24, 0, 8), (45, 69, 0, 60)]), []
    size = WIDTH, HEIGHT
    known_again(film.frames, film.seen, film.things, size, lambda *s: done.append(s))
    assert done == [(k, 70) for k in range(1, 71)]


def test_frames_must_be_those_of_the_tracks():
    film = Film(70, [(0, 24, 0, 8), (45, 69, 0, 60)])
    with pytest.raises(ValueError, match="tracks have 70 frames, but the arrays 60"):
        film.known_again(film.frames[:60])
    with pytest.raises(ValueError, match=r"160 x 120 pixels; those of .* 80 x 120"):
        film.known_again([frame[:, :80] for frame in film.frames])


def test_looks_are_those_of_the_last_frames_before_and_the_first_after(monkeypatch):
    """As if all frames were in memory at once."""
    visits = [(0, 47, 0, 8), (3, 26, 1, 64), (62, 99, 0, 8), (80, 99, 1, 64)]
    film, asked = Film(100, visits), []

    def remember(before, after, others):
        asked.append((before, after, others))
        return log_odds(before, after, others)

    monkeypatch.setattr(recognition, "log_odds", remember)
    film.known_again()
    shown = [
        recognition.seen_in(frame, points, film.things[rows])
        for frame, (rows, points) in zip(film.frames, film.seen(), strict=True)
    ]
    expected = []
    for new, first in ((3, 65), (4, 80)):
        for old, last in ((1, 45), (2, 25)):
            before = range(last - EVERY * (FRAMES_BEFORE - 1), last + 1, EVERY)
            if old == 2:
                before = range(5, 26, EVERY)
            after = range(first, min(first + EVERY * FRAMES_AFTER, 100), EVERY)
            expected.append((old, new, before, after))
    plain = [
        (
            np.concatenate([shown[k].of(old).descriptors for k in before]),
            np.concatenate([shown[k].of(new).descriptors for k in after]),
            np.concatenate([shown[k].but(old, new) for k in after]),
        )
        for old, new, before, after in expected
    ]
    assert len(asked) == len(plain)
    for own in plain:
        found = [
            (before.descriptors, after.descriptors, others)
            for before, after, others in asked
        ]
        assert any(
            all(np.array_equal(a, b) for a, b in zip(own, each, strict=True))
            for each in found
        )


def test_find_objects_takes_the_video():
    film = Film(100, [(0, 29, 0, 8), (70, 99, 0, 60)])
    X = pack_tracks(film.points)
    size = {"width": WIDTH, "height": HEIGHT}
    apart = find_objects(X, film.things, **size)
    joined = find_objects(X, film.things, **size, source=iter(film.frames))
    assert_array_equal(apart > 0, film.things > 0)
    assert apart.max() == 2
    assert_array_equal(joined, film.things > 0)


# --------------------------------------------------------------------------- evidence


def descriptors(rng, n):
    return rng.integers(0, 256, (n, 128)).astype(np.uint8)


def test_evidence_of_matches_is_the_ratio_of_likelihoods():
    rng = np.random.default_rng(0)
    before, others = descriptors(rng, 30), descriptors(rng, 60)
    after = descriptors(rng, 20)
    after[:2], others[:3] = before[:2], before[2:5]  # two match, and three of others
    share = 20 / 80

    def likelihood(p):
        return p**2 * (1 - p) ** 3

    same = quad(likelihood, share, 1)[0] / (1 - share)
    expected = np.log(same / likelihood(share))
    assert_allclose(match_evidence(before, after, others), expected, rtol=1e-6)


def test_evidence_of_matches_is_bounded_and_nothing_without_any():
    rng = np.random.default_rng(0)
    thing, other = descriptors(rng, 400), descriptors(rng, 400)
    assert match_evidence(thing, thing, other) == MOST_MATCHES
    assert match_evidence(thing, other, thing) < -4
    strangers = (descriptors(rng, 300) for _ in range(3))
    assert_allclose(match_evidence(*strangers), 0, atol=1e-9)


def test_overlap_of_colours():
    rng = np.random.default_rng(0)
    red = rng.normal([120, 190, 160], 10, (500, 3)).astype(np.uint8)
    green = rng.normal([120, 80, 160], 10, (500, 3)).astype(np.uint8)
    assert_allclose(overlap(red, red), 1)
    assert overlap(red[::2], red[1::2]) > 0.9
    assert overlap(red, green) < 0.05
    assert_allclose(overlap(red, green), overlap(green, red))


def test_too_little_of_a_thing_tells_nothing():
    rng = np.random.default_rng(0)
    colours = np.full((50, 3), 128, dtype=np.uint8)
    much, little = descriptors(rng, 60), descriptors(rng, 19)
    assert log_odds(Look(much, colours), Look(little, colours), much) == -np.inf
    assert log_odds(Look(little, colours), Look(much, colours), much) == -np.inf
    assert log_odds(Look(much, colours), Look(much, colours), much[:49]) == -np.inf
    assert np.isfinite(log_odds(Look(much, colours), Look(much, colours), much))
