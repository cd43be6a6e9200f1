"""Intervals and tests of the user study against published values, definitions and laws."""

from math import comb

import numpy as np
import pytest

from pipeline.study.answers import Answers
from pipeline.study.simulated import participants
from pipeline.study.statistics import chance, holm, pooled, tally, wilson
from tests.study_fixture import answers, made


def test_wilson_of_a_published_case():
    """Newcombe 1998, Table I: 81 of 263 and 15 of 148, method 3; given to four digits."""
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson(15, 148) == pytest.approx((0.0624, 0.1605), abs=5e-5)


@pytest.mark.parametrize("successes, trials", [(0, 11), (11, 11), (1, 2), (7, 11), (500, 1000)])
def test_wilson_bounds_are_where_the_score_test_just_rejects(successes, trials):
    """Its definition: |share - bound| = z sqrt(bound (1 - bound) / n), z of 95 %."""
    for bound in wilson(successes, trials):
        assert abs(successes / trials - bound) == pytest.approx(1.959963984540054 * np.sqrt(bound * (1 - bound) / trials), abs=1e-9)


def test_nothing_is_known_without_answers():
    assert wilson(0, 0) == (0.0, 1.0) and chance(0, 0) == 1.0


@pytest.mark.parametrize("trials", [1, 2, 7, 11, 12])
def test_chance_is_counted_over_all_guesses(trials):
    """Two-sided by symmetry: all outcomes at least as far from half, each of probability comb(n, k) / 2^n."""
    for k in range(trials + 1):
        far = sum(comb(trials, j) for j in range(trials + 1) if abs(2 * j - trials) >= abs(2 * k - trials))
        assert chance(k, trials) == pytest.approx(far / 2**trials, rel=1e-12)


def test_holm_of_a_worked_case():
    """Holm 1979's steps by hand: sorted .005 .01 .03 .04 times 4 3 2 1, never falling, at most 1."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.7, 0.8]) == [1.0, 1.0] and holm([]) == [] and holm([0.2]) == [0.2]


@pytest.mark.parametrize("seed", range(5))
def test_holm_rejects_what_its_steps_reject(seed):
    """Step down: reject while p_(k) <= level / (m - k + 1); nothing after the first that is not."""
    p, level = np.random.default_rng(seed).random(8) ** 3, 0.05
    rejected = set()
    for k, index in enumerate(np.argsort(p)):
        if p[index] > level / (len(p) - k):
            break
        rejected.add(int(index))
    assert {i for i, raised in enumerate(holm(p)) if raised <= level} == rejected


def test_tally_counts_each_stimulus(tmp_path):
    study = made(tmp_path)
    files = [answers(study, "AAAA-AAAA"), answers(study, "BBBB-BBBB"), answers(study, "CCCC-CCCC", right=False)]
    files[0]["trials"][1].update(answer=None, timed_out=True, milliseconds=15000)
    people = [Answers.model_validate(one) for one in files]
    plain, dense, told = tally(study.counted, people)
    assert (plain.shown, plain.picked_true, plain.picked_synthetic, plain.timed_out) == (3, 1, 1, 1)
    assert (dense.shown, dense.picked_true, dense.picked_synthetic, dense.timed_out) == (3, 2, 1, 0)
    assert told.true_is == "rendered truth" and dense.true_is == "photograph"
    assert plain.median_milliseconds == 2000, "what was not answered has no time"
    whole = pooled([plain, dense, told], people)
    assert (whole.picked_true, whole.picked_synthetic, whole.timed_out, whole.shown) == (5, 3, 1, 9)
    assert whole.p == pytest.approx(chance(5, 8)) and plain.p_holm >= plain.p


def test_a_stimulus_without_answers_is_no_test(tmp_path):
    study = made(tmp_path)
    one = answers(study)
    one["trials"] = one["trials"][:3]  # told was not reached
    plain, dense, told = tally(study.counted, [Answers.model_validate(one)])
    assert np.isnan(told.share) and told.p_holm == 1.0 and told.shown == 0
    assert plain.p_holm == dense.p_holm == 1.0


def test_guesses_are_told_from_chance_as_rarely_as_promised():
    """2000 studies of 50 who guess at three stimuli: with Holm at 5 % one or more differ from chance in at most 5 % of them.

    Its count stays below that + 4 standard errors = 7 %; without the correction it would be 10 % (33 of 1000 guesses of 50 have
    p < 0.05, as 17 or fewer are right, or 33 or more).
    """
    right = np.random.default_rng(4).binomial(50, 0.5, (2000, 3))
    p = {k: chance(k, 50) for k in range(51)}
    raw = [[p[int(k)] for k in study] for study in right]
    limit = 0.05 + 4 * np.sqrt(0.05 * 0.95 / 2000)
    assert 0.02 < np.mean([min(holm(one)) < 0.05 for one in raw]) < limit < np.mean([min(one) < 0.05 for one in raw])


def test_those_who_are_simulated_guess(tmp_path):
    """500 of them, three stimuli: right half the time, within 4 standard errors, and late as often as said."""
    study = made(tmp_path)
    people = participants(study, 500, 1)
    whole = pooled(tally(study.counted, people), people)
    assert whole.share == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(1500)) and whole.picked_a / whole.answered == pytest.approx(0.5, abs=0.06)
    assert whole.timed_out / 1500 == pytest.approx(0.03, abs=4 * np.sqrt(0.03 * 0.97 / 1500))
