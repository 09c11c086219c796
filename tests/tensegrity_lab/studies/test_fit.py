# SPDX-License-Identifier: Apache-2.0
"""`sixstrut fit`: from sessions and bags to an ensemble and odds; what does not belong together is refused."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from sim_core.dynamics.model import build_model
from sim_core.gaits.library import library_text
from sim_core.gaits.success_counts import load_success_counts
from sim_core.structure.parameters import load_prototype
from sim_core.studies.gait_learning import shipped_prior
from sim_core.uncertainty.ensemble import load_posterior
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.folder import LIBRARY, begin_session
from tensegrity_lab.session_data.ledger import Ledger
from tensegrity_lab.session_data.ledger_line import Outcome
from tensegrity_lab.studies import fit_trials
from tensegrity_lab.studies.fit import text_of
from tensegrity_lab.studies.fit_trials import read_tries
from tests.sixstrut_cli.test_commands import sixstrut
from tests.tensegrity_lab.trials.sessions import add, begun, graph, planned, try_all, with_chains

PLAN = planned("1", "TC6-TO5,TC6-TO7,TC7-TO11", repeats=2)
BAG = Path(__file__).parents[3] / "bags" / "example"


@pytest.fixture(scope="module")
def model():
    return build_model(load_prototype())


@pytest.fixture
def session(tmp_path):
    """Everything to TO5 fails; one trial is void."""
    folder = begun(tmp_path / "monday", PLAN)
    try_all(folder, {i: Outcome.FAILURE if slot.target == "TO5" else Outcome.SUCCESS for i, slot in enumerate(PLAN)})
    add(Ledger(folder.path), PLAN[0], Outcome.VOID)
    return folder


def test_a_session_s_successes_and_failures_are_its_trials(session, model):
    tries = read_tries([session.path], model)
    assert len(tries.seen) == len(PLAN)
    assert tries.counts["P1", "TC6", "TO5"] == (0, 2)
    assert tries.counts["P1", "TC6", "TO7"] == (2, 2)
    assert tries.virtual
    assert not any(one.placed for one in tries.seen), "a session of the stack does not tell which way the robot stood"
    assert tries.seen[0].roll.policy == PLAN[0].policy_mm


def test_odds_of_this_robot_fall_where_it_fails_and_stay_elsewhere(session, tmp_path):
    path = tmp_path / "odds.yaml"
    result = sixstrut("fit", str(session.path), "--counts-only", "--odds", str(path), "--weight", "4")
    assert result.returncode == 0, result.stderr
    assert "These are virtual trials" in result.stdout
    library = graph().library
    counts, before = load_success_counts(library, path), shipped_prior(library)
    gaits = [next(g for g in library.gaits("TC6", target) if g.primitive.name == "P1") for target in ("TO5", "TO7")]
    assert counts.probability(gaits[0]) == pytest.approx(before(gaits[0]) * 4 / 6, abs=1e-3)
    assert counts.probability(gaits[1]) == pytest.approx((before(gaits[1]) * 4 + 2) / 6, abs=1e-3)
    route = json.loads(sixstrut("route", "TC6", "TO5", "--odds", str(path), "--json").stdout)
    assert route["rolls"][0]["primitive"] != "P1"


@pytest.mark.slow
def test_a_fit_writes_an_ensemble_that_rehearsals_read(session, tmp_path, model):
    path = tmp_path / "ours.yaml"
    result = sixstrut("fit", str(session.path), "--ensemble", str(path), "--members", "4", "--rounds", "0", "--seed", "3", "--json")
    assert result.returncode == 0, result.stderr
    document = json.loads(result.stdout)
    assert document["trials"] == len(PLAN)
    assert document["estimates"][0]["label"] == "friction factor"
    posterior = load_posterior(path)
    assert posterior.model_hash == model.hash
    assert posterior.weights.sum() == pytest.approx(1.0)
    assert posterior.provenance["sessions"] == ["monday"]
    assert posterior.provenance["fit_seed"] == 3
    assert posterior.provenance["virtual"] is True
    rehearsed = sixstrut("rehearse", "--from", "TC6", "--to", "TO5", "--ensemble", str(path), "--members", "2")
    assert rehearsed.returncode == 0, rehearsed.stderr
    assert "fitted to 6 virtual trials of virtual one" in rehearsed.stdout


def test_a_bag_tells_its_rolls_too(model):
    tries = read_tries([BAG], model)
    assert tries.virtual
    assert len(tries.seen) > 0
    assert all(one.roll.target != one.roll.source for one in tries.seen)


def test_sessions_of_another_model_are_refused(tmp_path, model):
    folder = begun(tmp_path / "old", PLAN)
    library = replace(folder.library, model_hash="0123456789abcdef")
    other = begin_session(tmp_path / "other", replace(folder.settings, library_hash=library.hash), PLAN, library)
    assert (other.path / LIBRARY).read_text(encoding="utf-8") == library_text(library)
    try_all(other, {0: Outcome.SUCCESS})
    with pytest.raises(SessionError, match=r"are of model 0123456789abcdef.*give the --prototype"):
        read_tries([other.path], model)


@pytest.mark.slow
def test_what_does_not_belong_together_is_refused(session, tmp_path, model, monkeypatch):
    monkeypatch.setenv("SIXSTRUT_BAGS", str(tmp_path / "empty"))
    with pytest.raises(SessionError, match="given twice"):
        read_tries([session.path, session.path], model)
    another = begun(tmp_path / "tuesday", PLAN, robot="virtual two")
    with pytest.raises(SessionError, match="has an outcome"):
        read_tries([another.path], model)
    try_all(another, {0: Outcome.SUCCESS})
    with pytest.raises(SessionError, match="several robots: virtual one, virtual two"):
        read_tries([session.path, another.path], model)
    for words, message in (
        (["fit"], "there is no session in"),
        (["fit", str(session.path), "--counts-only"], "give --odds FILE"),
        (["fit", str(session.path), "--prior", "frictoin=1"], "valid is NAME=NUMBER with one of friction"),
        (["fit", str(tmp_path / "none")], "is not a session of trials"),
    ):
        result = sixstrut(*words)
        assert result.returncode in (1, 2)
        assert message in " ".join(result.stderr.replace("│", "").split())


def test_trials_in_a_bag_count_without_those_revoked(monkeypatch, session, model, tmp_path):
    """The same lines, as if they came from a bag."""
    ledger = Ledger(session.path)
    lines = [line for line in ledger.lines if line.event != "begin"]
    lines.append(replace(lines[0], event=type(lines[0].event)("revoke")))
    monkeypatch.setattr(fit_trials, "lines_in_bag", lambda path: lines)
    tries = read_tries([tmp_path / "a.mcap"], model)
    assert len(tries.seen) == len(PLAN) - 1


def test_chains_are_left_out_of_a_fit_which_says_so(tmp_path, model):
    plan = with_chains("reference") + planned("1", "reference")
    folder = begun(tmp_path / "chained", plan)
    try_all(folder, dict.fromkeys(range(3), Outcome.SUCCESS))
    tries = read_tries([folder.path], model)
    assert (tries.names, tries.chains) == (("P1",), 2)
    assert "2 chain(s) are left out: a fit takes single rolls" in text_of(tries, None)
    alone = begun(tmp_path / "alone", with_chains("reference"))
    try_all(alone, {0: Outcome.SUCCESS})
    with pytest.raises(SessionError, match="void and revoked ones and chains do not count"):
        read_tries([alone.path], model)
