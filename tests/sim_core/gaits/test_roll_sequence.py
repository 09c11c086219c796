# SPDX-License-Identifier: Apache-2.0
"""The phases of a roll."""

from dataclasses import replace

import pytest

from sim_core.errors import RollRefused
from sim_core.gaits.roll_sequence import Link, Move, Phase, RollOutcome, RollPlan, RollRules, RollSequence, Seen, View

NEUTRAL = (0.234,) * 6
POLICY = (0.240, 0.230, 0.250, 0.234, 0.220, 0.234)
S = 1_000_000_000


def rules(observe: bool = True) -> RollRules:
    return RollRules(NEUTRAL, observe, settle_timeout_s=20.0, confirm_timeout_s=60.0)


def plan_from(source: str) -> RollPlan:
    if source == "TC1":
        raise RollRefused("TO5 is not adjacent to TC1")
    return RollPlan(source, "TO5", POLICY)


def view(at_s: float, face: str | None = "TC6", rest: bool = True, observer: bool = True, **changes: object) -> View:
    """Twin and, if there is one, observer agree, and have just looked."""
    now = round(at_s * S)
    predicted = Seen(face, rest, now, "predicted")
    observed = replace(predicted, source="prototype") if observer else None
    return replace(View(now, NEUTRAL, predicted, observed, observer), **changes)  # type: ignore[arg-type]


def begun(observe: bool = True, observer: bool = True) -> RollSequence:
    sequence = RollSequence(rules(observe), plan_from)
    assert sequence.begin(view(0.0, observer=observer)) == Move(Phase.ACTUATE, POLICY)
    return sequence


def test_a_policy_in_stages_is_one_motion_over_the_first_stage():
    sequence = RollSequence(rules(), lambda source: RollPlan(source, "TO5", POLICY, via=(NEUTRAL,)))
    assert sequence.begin(view(0.0)) == Move(Phase.ACTUATE, POLICY, via=(NEUTRAL,))


def test_a_roll_actuates_settles_returns_settles_and_reports():
    sequence = begun()
    assert sequence.look(view(1.0, rest=False)) is None
    sequence.moved(view(3.0, rest=False))
    assert sequence.look(view(3.5, "TO5", rest=False)) is None
    assert sequence.look(view(4.0, "TO5")) == Move(Phase.RETURN, NEUTRAL)
    sequence.moved(view(7.0, "TO5", rest=False))
    outcome = sequence.look(view(8.0, "TO5"))
    assert outcome == RollOutcome(True, "", "TO5", "TO5", ("TC6", "TO5"), 7.0, rolls=1)


def test_rest_before_the_end_of_the_motion_counts_for_nothing():
    sequence = begun()
    sequence.moved(view(3.0))
    stale = view(2.9, "TO5")
    assert sequence.look(replace(stale, robot_time_ns=4 * S)) is None


def test_the_wrong_face_still_returns_to_neutral_and_then_fails():
    sequence = begun()
    sequence.moved(view(3.0, rest=False))
    assert sequence.look(view(4.0, "TC6")) == Move(Phase.RETURN, NEUTRAL)
    sequence.moved(view(7.0, rest=False))
    outcome = sequence.look(view(8.0, "TC6"))
    assert isinstance(outcome, RollOutcome)
    assert not outcome.success
    assert outcome.reason == "after actuation the robot stands on TC6 (prototype), not on TO5"


def test_falling_back_on_the_return_is_a_failure():
    sequence = begun()
    sequence.moved(view(3.0, rest=False))
    sequence.look(view(4.0, "TO5"))
    sequence.moved(view(7.0, rest=False))
    outcome = sequence.look(view(8.0, None))
    assert isinstance(outcome, RollOutcome)
    assert outcome.reason == "after the return the robot stands on no face (prototype), not on TO5"
    assert outcome.observed_face == ""


def test_what_the_observer_saw_outweighs_the_twin():
    sequence = begun()
    sequence.moved(view(3.0, rest=False))
    wrong_twin = replace(view(4.0, "TO5"), predicted=Seen("TC6", True, 4 * S, "predicted"))
    assert sequence.look(wrong_twin) == Move(Phase.RETURN, NEUTRAL)
    sequence.moved(view(7.0, rest=False))
    outcome = sequence.look(view(8.0, "TO5"))
    assert isinstance(outcome, RollOutcome)
    assert outcome.success


def test_with_confirm_predicted_the_twin_is_enough():
    sequence = begun(observe=False, observer=False)
    sequence.moved(view(3.0, rest=False, observer=False))
    sequence.look(view(4.0, "TO5", observer=False))
    sequence.moved(view(7.0, rest=False, observer=False))
    outcome = sequence.look(view(8.0, "TO5", observer=False))
    assert outcome == RollOutcome(True, "", "TO5", "", ("TC6", "TO5"), 7.0, rolls=1)


def confirming() -> RollSequence:
    sequence = begun(observer=False)
    sequence.moved(view(3.0, rest=False, observer=False))
    sequence.look(view(4.0, "TO5", observer=False))
    sequence.moved(view(7.0, rest=False, observer=False))
    assert sequence.look(view(8.0, "TO5", observer=False)) is None
    assert sequence.phase is Phase.CONFIRM
    return sequence


def test_without_an_observer_a_person_confirms():
    said = Seen("TO5", True, 20 * S, "operator")
    outcome = confirming().look(view(20.1, "TO5", observer=False, observed=said))
    assert isinstance(outcome, RollOutcome)
    assert outcome.success
    assert outcome.observed_face == "TO5"


def test_a_person_who_saw_another_face_is_believed():
    said = Seen("TC6", True, 20 * S, "operator")
    outcome = confirming().look(view(20.1, "TO5", observer=False, observed=said))
    assert isinstance(outcome, RollOutcome)
    assert outcome.reason == "after the return the robot stands on TC6 (operator), not on TO5"


def test_nobody_to_confirm_is_a_failure_that_says_what_to_do():
    outcome = confirming().look(view(68.0, "TO5", observer=False))
    assert isinstance(outcome, RollOutcome)
    assert not outcome.success
    assert "set_face" in outcome.reason
    assert outcome.predicted_face == "TO5"


def test_a_robot_that_does_not_settle_is_returned_and_reported():
    sequence = begun()
    sequence.moved(view(3.0, rest=False))
    assert sequence.look(view(22.9, rest=False)) is None
    assert sequence.look(view(23.1, rest=False)) == Move(Phase.RETURN, NEUTRAL)
    sequence.moved(view(26.0, rest=False))
    outcome = sequence.look(view(27.0, "TC6"))
    assert isinstance(outcome, RollOutcome)
    assert outcome.reason == "no observer saw the robot at rest within 20 s"


def test_a_restless_twin_does_not_fail_a_roll_that_was_seen():
    sequence = begun()
    sequence.moved(view(3.0, rest=False))
    restless = replace(view(4.0, "TO5"), predicted=Seen("TO5", False, 4 * S, "predicted"))
    assert sequence.look(restless) is None
    later = replace(restless, robot_time_ns=24 * S)
    assert sequence.look(later) == Move(Phase.RETURN, NEUTRAL)
    sequence.moved(view(27.0, rest=False))
    outcome = sequence.look(view(28.0, "TO5"))
    assert isinstance(outcome, RollOutcome)
    assert outcome.success


def test_struts_that_are_not_neutral_go_there_first():
    sequence = RollSequence(rules(), plan_from)
    assert sequence.begin(view(0.0, lengths_m=POLICY)) == Move(Phase.TO_NEUTRAL, NEUTRAL)
    sequence.moved(view(2.0, rest=False))
    assert sequence.look(view(3.0, "TC5")) == Move(Phase.ACTUATE, POLICY)
    assert sequence.plan == RollPlan("TC5", "TO5", POLICY)


def test_a_roll_that_cannot_be_is_refused_before_anything_moves():
    with pytest.raises(RollRefused, match="not adjacent"):
        RollSequence(rules(), plan_from).begin(view(0.0, "TC1", lengths_m=POLICY))
    with pytest.raises(RollRefused, match="stands on no face"):
        RollSequence(rules(), plan_from).begin(view(0.0, None))
    with pytest.raises(RollRefused, match="nobody knows the face"):
        RollSequence(rules(), plan_from).begin(View(0, NEUTRAL, None, None, False))


def test_the_observed_face_is_where_a_roll_starts_whatever_the_twin_thinks():
    sequence = RollSequence(rules(), plan_from)
    sequence.begin(replace(view(0.0, "TC5"), predicted=Seen("TC1", True, 0, "predicted")))
    assert sequence.plan is not None
    assert sequence.plan.source == "TC5"


def test_an_end_for_another_reason_keeps_the_first_reason():
    sequence = begun()
    sequence.moved(view(3.0, rest=False))
    sequence.look(view(4.0, "TC6"))
    outcome = sequence.end(view(5.0, "TC6"), "the bridge is in FAULT")
    assert outcome.reason == "after actuation the robot stands on TC6 (prototype), not on TO5"


def test_faces_on_the_way_are_listed_once_each():
    sequence = begun()
    for at_s, face in ((0.5, "TC6"), (1.0, None), (1.5, "TO5"), (2.0, "TO5"), (2.5, "TC8"), (2.6, "TO5")):
        sequence.look(view(at_s, face, rest=False))
    assert sequence.end(view(3.0, "TO5")).faces == ("TC6", "TO5", "TC8", "TO5")


# ---- chains ---------------------------------------------------------------------------------------------------------

FIRST, SECOND = (0.25,) * 6, (0.21,) * 6
LINKS = (Link(FIRST, "TO5", 0.2, 3.0), Link(SECOND, "TC3", 0.0, 4.0))


def chain(links: tuple[Link, ...] = LINKS, blind: bool = False, observe: bool = True) -> RollSequence:
    sequence = RollSequence(rules(observe), lambda source: RollPlan(source, links[-1].onto, (), links=links, blind=blind))
    assert sequence.begin(view(0.0)) == Move(Phase.ROLL_ON, FIRST)
    return sequence


def test_a_chain_goes_on_when_the_next_face_is_seen_though_nothing_rests():
    sequence = chain()
    assert sequence.look(view(2.0, "TC6", rest=False)) is None
    assert sequence.look(view(3.0, "TO5", rest=False)) is None, "it dwells"
    assert sequence.look(view(3.21, None, rest=False)) == Move(Phase.ROLL_ON, SECOND, overtakes=True)
    sequence.moved(view(5.0, "TO5", rest=False))
    assert sequence.look(view(6.0, "TO5", rest=False)) is None
    assert sequence.look(view(7.0, "TC3", rest=False)) == Move(Phase.RETURN, NEUTRAL, overtakes=True)
    sequence.moved(view(9.0, "TC3", rest=False))
    assert sequence.look(view(9.5, "TC3", rest=False)) is None
    outcome = sequence.look(view(10.0, "TC3"))
    assert outcome == RollOutcome(True, "", "TC3", "TC3", ("TC6", "TO5", "TC3"), 9.0, rolls=2)


def test_a_face_seen_before_the_link_began_counts_for_nothing():
    sequence = chain()
    stale = replace(view(0.0, "TO5"), robot_time_ns=1 * S)
    assert sequence.look(stale) is None
    assert sequence.look(replace(stale, robot_time_ns=2 * S)) is None


@pytest.mark.parametrize(
    ("face", "why"), [("TC1", "on the way to TO5 it came to TC1 (prototype)"), (None, "it did not come onto TO5")]
)
def test_a_miss_ends_a_chain_in_neutral(face, why):
    sequence = chain()
    step = sequence.look(view(12.1, face, rest=False))
    assert step == Move(Phase.RETURN, NEUTRAL, overtakes=True)
    sequence.moved(view(14.0, face, rest=False))
    outcome = sequence.look(view(15.0, face))
    assert isinstance(outcome, RollOutcome)
    assert not outcome.success
    assert why in outcome.reason
    assert outcome.rolls == 0


def test_a_blind_chain_goes_by_its_times():
    sequence = chain(blind=True)
    assert sequence.look(view(2.9, "TC6", observer=False)) is None
    assert sequence.look(view(3.0, "TC6", observer=False)) == Move(Phase.ROLL_ON, SECOND, overtakes=True)
    assert sequence.look(view(6.9, "TC1", observer=False)) is None
    assert sequence.look(view(7.0, "TC1", observer=False)) == Move(Phase.RETURN, NEUTRAL, overtakes=True)


def test_a_chain_that_ends_early_does_so_on_a_tc():
    more = (*LINKS, Link(FIRST, "TO4", 0.0, 3.0), Link(SECOND, "TC4", 0.0, 3.0))
    sequence = chain(more)
    sequence.end_early("duty is nearly spent")
    sequence.look(view(3.0, "TO5", rest=False))
    assert sequence.look(view(3.3, "TO5", rest=False)) == Move(Phase.ROLL_ON, SECOND, overtakes=True), "not on a TO"
    assert sequence.look(view(7.0, "TC3", rest=False)) == Move(Phase.RETURN, NEUTRAL, overtakes=True)
    sequence.moved(view(9.0, "TC3", rest=False))
    outcome = sequence.look(view(10.0, "TC3"))
    assert isinstance(outcome, RollOutcome)
    assert (outcome.success, outcome.reason) == (False, "ended on TC3: duty is nearly spent")
    assert (outcome.observed_face, outcome.rolls, outcome.ended_early) == ("TC3", 2, True)


def test_a_refused_link_brings_the_robot_to_neutral():
    sequence = chain()
    sequence.look(view(3.0, "TO5", rest=False))
    assert sequence.give_up("the bridge ended the motion: no duty left", missed=False) == Move(
        Phase.RETURN, NEUTRAL, overtakes=True
    )
    sequence.moved(view(6.0, "TO5", rest=False))
    outcome = sequence.look(view(7.0, "TO5"))
    assert isinstance(outcome, RollOutcome)
    assert (outcome.reason, outcome.ended_early) == ("the bridge ended the motion: no duty left", True)


def test_a_chain_that_nobody_sees_or_feels_any_more_does_not_go_on_by_prediction():
    sequence = chain()
    assert sequence.look(view(2.0, "TC6", rest=False)) is None
    lost = view(2.5, "TO5", rest=False, observer=False)
    assert sequence.look(lost) == Move(Phase.RETURN, NEUTRAL, overtakes=True)
    sequence.moved(view(4.0, "TO5", rest=False))
    outcome = sequence.look(view(5.0, "TO5"))
    assert isinstance(outcome, RollOutcome)
    assert (outcome.reason, outcome.ended_early) == ("on the way to TO5 nobody tells the face any more", True)
    assert chain(observe=False).look(view(3.0, "TO5", rest=False, observer=False)) is None, "a prediction is enough: it dwells"
