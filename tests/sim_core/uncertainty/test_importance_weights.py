# SPDX-License-Identifier: Apache-2.0
"""Weights, rounds and scores, against closed forms."""

import numpy as np
import pytest

from sim_core.errors import SimError
from sim_core.uncertainty import importance_weights as bayes


def test_a_beta_posterior_is_the_textbook_one():
    assert bayes.beta_mean(0.5, 2.0, 3, 4) == pytest.approx(4 / 6)  # Laplace's rule of succession
    assert bayes.beta_mean(0.9, 4.0, 0, 0) == 0.9
    assert bayes.beta_mean(0.8, 5.0, 0, 5) == pytest.approx(0.4)


@pytest.mark.parametrize("wrong", [(1.1, 2.0, 0, 1), (0.5, 0.0, 0, 1), (0.5, 2.0, 2, 1)])
def test_an_impossible_count_is_refused(wrong):
    with pytest.raises(SimError, match="valid are a probability"):
        bayes.beta_mean(*wrong)


def test_weights_follow_bayes_and_sum_to_one():
    wins = np.array([[True, True], [True, False], [False, False]])
    weights = bayes.normalised(bayes.log_likelihood(wins, np.array([True, True]), lapse=0.1))
    np.testing.assert_allclose(weights, np.array([0.81, 0.09, 0.01]) / 0.91)
    assert bayes.effective_size(weights) == pytest.approx(0.91**2 / (0.81**2 + 0.09**2 + 0.01**2))
    assert bayes.effective_size(np.full(8, 1 / 8)) == pytest.approx(8.0)


def test_one_odd_trial_does_not_kill_a_member():
    wins = np.array([[True] * 20, [False] * 20])
    observed = np.array([True] * 19 + [False])
    assert bayes.normalised(bayes.log_likelihood(wins, observed))[0] > 0.999


def test_a_lapse_rate_is_softened_no_further_than_needed():
    rng = np.random.default_rng(6)
    wins, observed, base = rng.random((64, 20)) < 0.5, np.array([True] * 20), np.zeros(64)

    def size(lapse):
        return bayes.effective_size(bayes.normalised(bayes.log_likelihood(wins, observed, lapse)))

    assert size(0.03) < 8.0, "the case is to need it"
    lapse = bayes.softened(wins, observed, 0.03, base, 8.0)
    assert size(lapse) == pytest.approx(8.0, abs=0.01)
    assert bayes.softened(wins, observed, lapse + 0.01, base, 8.0) == lapse + 0.01, "enough already: left alone"
    assert bayes.softened(wins, observed, 0.03, np.array([50.0] + [0.0] * 63), 8.0) == pytest.approx(0.5, abs=1e-5)


def test_later_rounds_are_weighted_as_draws_from_the_prior_would_be():
    """A normal likelihood under a normal prior: posterior mean and variance in closed form, whatever the rounds were drawn from."""
    rng, count = np.random.default_rng(3), 600
    z = rng.standard_normal((count, 2))

    def log_like(at):
        return -0.5 * ((at[:, 0] - 2.0) / 0.5) ** 2

    kernels = []
    for _ in range(2):
        weights = bayes.normalised(bayes.log_weights_of(log_like(z), z, count, kernels))
        kernel = bayes.kernel_around(z, weights)
        kernels.append((kernel, count))
        z = np.vstack([z, bayes.drawn_from(kernel, count, rng)])
    weights = bayes.normalised(bayes.log_weights_of(log_like(z), z, count, kernels))
    mean = weights @ z
    np.testing.assert_allclose(mean, [1.6, 0.0], atol=0.1)
    np.testing.assert_allclose(weights @ (z - mean) ** 2, [0.2, 1.0], rtol=0.25)
    first = bayes.normalised(log_like(z[:count]))
    assert bayes.effective_size(weights) > 2 * bayes.effective_size(first)


def test_a_kernel_keeps_mean_and_spread():
    rng = np.random.default_rng(1)
    z, weights = rng.standard_normal((500, 3)), np.full(500, 1 / 500)
    kernel = bayes.kernel_around(z, weights)
    drawn = bayes.drawn_from(kernel, 20_000, rng)
    np.testing.assert_allclose(drawn.mean(axis=0), z.mean(axis=0), atol=0.03)
    np.testing.assert_allclose(np.cov(drawn.T), np.cov(z.T), atol=0.05)


def test_systematic_draws_are_as_even_as_they_can_be():
    weights = np.array([0.5, 0.3, 0.2])
    chosen = bayes.systematic(weights, 10, np.random.default_rng(2))
    assert [int((chosen == i).sum()) for i in range(3)] == [5, 3, 2]


def test_weighted_quantiles_of_equal_weights_are_the_plain_ones():
    values = np.array([3.0, 1.0, 2.0, 4.0])
    assert bayes.quantiles(values, np.full(4, 0.25), (0.25, 0.5, 1.0)).tolist() == [1.0, 2.0, 4.0]


def test_a_gait_s_own_trials_count_once():
    """Leaving a gait's trials out gives the weights that the others alone would have given."""
    rng = np.random.default_rng(5)
    wins, observed = rng.random((50, 6)) < 0.5, rng.random(6) < 0.5
    weights = bayes.normalised(bayes.log_likelihood(wins, observed))
    own = np.where(wins == observed, np.log1p(-bayes.LAPSE), np.log(bayes.LAPSE))
    found = bayes.predictive_without_own(wins, weights, own)
    for gait in range(6):
        others = np.arange(6) != gait
        without = bayes.normalised(bayes.log_likelihood(wins[:, others], observed[others]))
        assert found[gait] == pytest.approx(bayes.predictive(wins[:, [gait]], without)[0])


def test_the_log_score_of_a_coin_is_ln_one_half():
    observed = np.array([True, False, True])
    assert bayes.log_score(np.full(3, 0.5), observed) == pytest.approx(np.log(0.5))
    assert bayes.log_score(np.array([0.9, 0.1, 0.9]), observed) == pytest.approx(np.log(0.9))


def test_impossible_lapses_and_shapes_are_refused():
    with pytest.raises(SimError, match="between 0 and"):
        bayes.log_likelihood(np.ones((2, 2), bool), np.ones(2, bool), lapse=0.0)
    with pytest.raises(SimError, match="valid are"):
        bayes.log_likelihood(np.ones((2, 2), bool), np.ones(3, bool))
    with pytest.raises(SimError, match="without members"):
        bayes.normalised(np.zeros(0))
