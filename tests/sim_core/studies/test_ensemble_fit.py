# SPDX-License-Identifier: Apache-2.0
"""Fits: outcomes of a hidden robot narrow down what it is; files hold what was fitted."""

from dataclasses import replace

import numpy as np
import pytest

from sim_core.errors import LibraryError, ParameterError
from sim_core.gaits.library import gait_of, load_library
from sim_core.gaits.success_counts import MEANS, load_success_counts, success_counts_text
from sim_core.rolling.batch import Job, roll_many
from sim_core.search.genetic_search import SearchPlan
from sim_core.search.training_robots import FittedTraining
from sim_core.structure.roll_classes import rolls_of
from sim_core.studies.ensemble_fit import Roll, Seen, estimates, fit, prior_members, stood_on_target, wins_of
from sim_core.studies.gait_learning import learned_counts
from sim_core.studies.local_runner import Chunk, run_chunk
from sim_core.studies.rehearsal import Ensemble
from sim_core.studies.robustness import training_seeds
from sim_core.uncertainty.ensemble import EnsembleError, Posterior, load_posterior, posterior_text
from sim_core.uncertainty.fit_prior import LABELS, Member, Prior, member_model

LEVEL = Prior(friction=0.0, stiffness=0.0, rest_length=0.0, stroke=0.0, slope_deg=6.0, noise=0.0)
FRICTION = replace(LEVEL, friction=0.6, slope_deg=0.0)


@pytest.fixture(scope="module")
def rolls():
    """Twelve gaits of one primitive: they roll to all sides."""
    primitive = load_library("improved").primitives[0]
    return [Roll(s, t, gait_of(primitive, s, t).policy) for s, t in rolls_of(primitive.roll_class)[::2]]


@pytest.fixture(scope="module")
def fitted(model, rolls):
    """A fit to a floor that is tilted by five degrees about x, with the trials."""
    hidden = Member(1.0, 1.0, 1.0, (1.0,) * 6, (5.0, 0.0), 0.0, 1, 0)
    won = wins_of(model, [hidden], [(roll, True) for roll in rolls])[0]
    seen = [Seen(roll, bool(w), True) for roll, w in zip(rolls, won, strict=True)]
    return fit(model, seen, LEVEL, 32, seed=4, rounds=1), seen


def as_posterior(model, found, **more):
    return Posterior(
        model.hash, {"trials": 6, "robot": "hidden", "virtual": True, **more}, LEVEL.noise, found.members, found.weights
    )


@pytest.mark.slow
def test_a_fit_finds_the_side_that_the_floor_is_tilted_to(fitted):
    found, seen = fitted
    assert 0 < sum(trial.won for trial in seen) < len(seen), "the hidden floor is to matter"
    assert found.weights.sum() == pytest.approx(1.0)
    slope = dict(zip(LABELS, found.weights @ found.parameters, strict=True))
    assert slope["slope about x (deg)"] > 1.0


def test_a_posterior_concentrates_on_the_hidden_friction(model):
    """Gaits that work above a friction of their own, on a robot of friction 0.68: a rule instead of rolls, so all is known."""
    thresholds = np.linspace(0.42, 1.58, 30)
    _, members = prior_members(FRICTION, 256, 3)
    first = np.array([member.friction for member in members])[:, None] > thresholds
    seen = [Seen(Roll("TC6", "TO5", (0,) * 6), bool(t < 0.68), True) for t in thresholds]
    found = fit(model, seen, FRICTION, 256, seed=3, rounds=0, first_wins=first)
    told = estimates(found.parameters, found.weights, LABELS, [0.6, *[0.0] * 10])[0]
    assert told.mean == pytest.approx(0.68, abs=0.02)
    assert told.low < 0.68 < told.high
    assert told.told < 0.1


def test_the_same_seed_gives_the_same_ensemble_and_another_another(model, fitted):
    seen = fitted[1][:3]
    found, again = (fit(model, seen, LEVEL, 6, seed=4, rounds=1) for _ in range(2))
    assert again.members == found.members
    assert again.weights.tobytes() == found.weights.tobytes()
    assert prior_members(LEVEL, 6, 5)[1] != found.members[:6]


def test_a_second_round_is_drawn_where_few_members_carry_the_weight(fitted):
    found, _ = fitted
    assert len(found.members) == 32 * len(found.effective_sizes)
    needed = found.effective_sizes[0] < 8.0 or found.lapses[0] > found.lapse
    assert needed == (len(found.effective_sizes) == 2)


def test_a_trial_is_won_by_the_faces_alone(model, rolls):
    """As a person judges it: with the batch's own rolls."""
    member = Member(1.0, 1.0, 1.0, (1.0,) * 6, (0.0, 0.0), 0.0, 1, 0)
    result = roll_many([member_model(model, member)], [Job(0, rolls[0].source, rolls[0].policy, rolls[0].target)])[0]
    assert stood_on_target(result)
    assert stood_on_target(replace(result, feasible=False, reason="strut force"))
    assert not stood_on_target(replace(result, returned=None))


def test_a_heading_nobody_knows_is_another_in_every_trial(model, rolls):
    steep = Member(1.0, 1.0, 1.0, (1.0,) * 6, (6.0, 0.0), 0.0, 1, 0)
    placed = wins_of(model, [steep], [(rolls[0], True)] * 8)[0]
    loose = wins_of(model, [steep], [(rolls[0], False)] * 8)[0]
    assert len(set(placed.tolist())) == 1
    assert len(set(loose.tolist())) == 2
    assert (wins_of(model, [steep], [(rolls[0], False)] * 8)[0] == loose).all()


def test_an_ensemble_file_holds_what_was_fitted(model, fitted, tmp_path):
    written = as_posterior(model, fitted[0])
    (tmp_path / "mine.yaml").write_text(posterior_text(written), encoding="utf-8")
    read = load_posterior(tmp_path / "mine.yaml")
    np.testing.assert_allclose(read.weights, written.weights, rtol=1e-6)
    np.testing.assert_allclose([m.parameters for m in read.members], [m.parameters for m in written.members], rtol=1e-6)
    assert read.provenance == written.provenance
    assert (read.model_hash, read.noise) == (model.hash, 0.0)
    assert read.drawn(7, 1) == read.drawn(7, 1)


def test_files_that_are_no_ensembles_are_refused(tmp_path, model, fitted):
    with pytest.raises(EnsembleError, match="cannot read ensemble"):
        load_posterior(tmp_path / "none.yaml")
    path = tmp_path / "other.yaml"
    path.write_text("schema: 1\n", encoding="utf-8")
    with pytest.raises(EnsembleError, match="is not an ensemble of this version"):
        load_posterior(path)
    whole = posterior_text(as_posterior(model, fitted[0]))
    path.write_text(whole + "- [1, 2]\n", encoding="utf-8")
    with pytest.raises(EnsembleError, match="valid members are lists of 14 numbers"):
        load_posterior(path)
    foreign = replace(as_posterior(model, fitted[0]), model_hash="0123")
    with pytest.raises(EnsembleError, match="is of model 0123"):
        Ensemble(model, foreign)


def test_rehearsals_and_searches_use_a_fitted_ensemble(model, fitted):
    posterior = as_posterior(model, fitted[0])
    primitive = load_library("improved").primitives[0]
    uphill = next(trial.roll for trial in fitted[1] if not trial.won)
    rehearsed = Ensemble(model, posterior, members=8).rehearse([gait_of(primitive, uphill.source, uphill.target)])
    assert rehearsed[0].rate.value < 0.5
    training = FittedTraining(posterior, 8, 5)
    tries = training.tries
    assert len({one.gait for one in tries}) == 8, "every member tries another gait"
    jobs = tuple(one.job(primitive.roll_class, primitive.policy)._replace(model=k) for k, one in enumerate(tries))
    trials = run_chunk(Chunk(model.prototype, tuple(one.robot for one in tries), jobs))
    assert trials.feasible.shape == (8,)
    plan = SearchPlan("mine", training=(training,))
    assert plan.as_dict()["training"] == [{"law": posterior.text, "prototypes": 8, "seed": 5}]
    library = replace(load_library("improved"), provenance={"plan": plan.as_dict()})
    assert 5 in training_seeds(library)


def test_odds_of_one_robot_are_read_by_the_planner_as_written(tmp_path):
    library = load_library("improved")
    primitive = library.primitives[0]
    source, target = rolls_of(primitive.roll_class)[3]
    counts = learned_counts(library, lambda gait: 0.8, {(primitive.name, source, target): (0, 4)}, weight=4.0, how="here")
    (tmp_path / "odds.yaml").write_text(success_counts_text(counts), encoding="utf-8")
    read = load_success_counts(library, tmp_path / "odds.yaml")
    assert read.probability(gait_of(primitive, source, target)) == pytest.approx(0.4, abs=1 / MEANS)
    other = rolls_of(primitive.roll_class)[4]
    assert read.probability(gait_of(primitive, *other)) == pytest.approx(0.8, abs=1 / MEANS)
    assert "not trials" in read.how
    with pytest.raises(LibraryError, match="has no gait X"):
        learned_counts(library, lambda gait: 0.8, {("X", source, target): (0, 4)})


def test_impossible_priors_and_counts_are_refused(model):
    with pytest.raises(ParameterError, match="prior of friction"):
        Prior(friction=0.95)
    with pytest.raises(ParameterError, match="two or more"):
        prior_members(LEVEL, 1, 1)
    with pytest.raises(ParameterError, match="there is no trial"):
        fit(model, [])
