# SPDX-License-Identifier: Apache-2.0
"""What a page may ask for: a gate that knows every order, and refuses the rest with a word."""

import pytest

from tensegrity_console.web.main import Orders
from tensegrity_console.web.state import Facts, Selection


class Ros:
    """Writes down what would be asked of the stack; a recorder and no stack, for the gate alone is tested here."""

    def __init__(self):
        self.calls = []
        self.facts = Facts(predicted="TC6", trial={"panel": "the newest"})

    def __getattr__(self, name):
        def call(*words):
            self.calls.append((name, *[word for word in words if not callable(word)]))
            for word in words:
                if callable(word):
                    word(True, f"{name} done")

        return call


@pytest.fixture
def gate():
    ros = Ros()
    orders, answers = Orders(ros), []
    page = orders.arrived()
    page.selection = Selection("TO5", (1.0, -0.5), "TC6")
    return ros, page, answers, lambda order: orders.carry_out(page, order, answers.append)


@pytest.mark.parametrize(
    ("order", "call"),
    [
        ({"do": "stop"}, ("stop",)),
        ({"do": "arm", "lifted_and_clear": True}, ("arm",)),
        ({"do": "disarm"}, ("disarm",)),
        ({"do": "reset"}, ("reset",)),
        ({"do": "cancel"}, ("cancel",)),
        ({"do": "roll", "target": "TO5"}, ("roll", "TO5", False)),
        ({"do": "roll", "target": "TO5", "anyway": True}, ("roll", "TO5", True)),
        ({"do": "face", "face": "TC1"}, ("set_face", "TC1")),
        ({"do": "travel", "place_m": [1, -0.5]}, ("travel", (1.0, -0.5))),
    ],
)
def test_an_order_is_passed_on_and_its_answer_comes_back(gate, order, call):
    ros, _, answers, ask = gate
    ask(order)
    assert ros.calls == [call]
    assert answers == [{"answer": {"do": order["do"], "done": True, "words": f"{call[0]} done"}}]


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ({"do": "roll", "target": "TC9"}, "unknown face 'TC9'"),
        ({"do": "roll"}, "unknown face None"),
        ({"do": "face", "face": ["TC1"]}, "unknown face"),
        ({"do": "travel", "place_m": "far"}, "a place is two numbers"),
        ({"do": "travel", "place_m": [float("nan"), 0.0]}, "a place is two numbers"),
        ({"do": "travel", "place_m": [1e6, 0.0]}, "a place is two numbers"),
        ({"do": "execute_struts"}, "unknown order 'execute_struts'"),
        ({}, "unknown order 'None'"),
        ({"do": "arm"}, "somebody must say first"),
        ({"do": "arm", "lifted_and_clear": "yes"}, "somebody must say first"),
        ({"do": ["stop"]}, "unknown order"),
        ({"do": "roll", "target": "TO7"}, "TO7 is not what this page has selected now"),
        ({"do": "travel", "place_m": [1.0, 0.5]}, "not the place that this page has selected now"),
        ({"do": "key", "key": ["y"], "panel": "the newest"}, "unknown order 'key'"),
        ({"do": "key", "key": "rm", "panel": "the newest"}, "unknown order 'key'"),
        ({"do": "key", "key": "y"}, "look again"),
        ({"do": "key", "key": "y", "panel": "an older one"}, "look again"),
        ({"do": "key", "key": "y", "panel": ""}, "look again"),
        ({"do": "\x1b[2Jstop"}, "unknown order '\\x1b[2Jstop'"),
    ],
)
def test_anything_else_is_refused_with_a_word_and_reaches_nobody(gate, order, words):
    ros, _, answers, ask = gate
    ask(order)
    assert ros.calls == []
    assert answers[0]["answer"]["done"] is False
    assert words in answers[0]["answer"]["words"]


def test_a_selection_moves_nothing_and_asks_for_the_odds(gate):
    ros, page, answers, ask = gate
    ask({"do": "select", "target": "TO7"})
    assert page.selection == Selection("TO7", stood="TC6")
    assert ros.calls == [("rehearse", "TO7")]
    assert answers == []


def test_what_one_page_selects_no_other_page_s_button_means():
    ros = Ros()
    orders, answers = Orders(ros), []
    one, other = orders.arrived(), orders.arrived()
    assert one.number != other.number
    orders.carry_out(one, {"do": "select", "target": "TO7"}, answers.append)
    orders.carry_out(other, {"do": "select", "target": "TO5"}, answers.append)
    orders.carry_out(other, {"do": "roll", "target": "TO7"}, answers.append)
    assert [call for call in ros.calls if call[0] == "roll"] == []
    orders.carry_out(one, {"do": "roll", "target": "TO7"}, answers.append)
    assert ros.calls[-1] == ("roll", "TO7", False)
    orders.left(one)
    assert list(orders.pages.values()) == [other]


def test_a_face_that_was_selected_before_the_robot_rolled_is_none_any_more(gate):
    ros, page, answers, ask = gate
    ros.facts.predicted = "TO5"
    assert page.selected(ros.facts) == Selection("", (1.0, -0.5))
    ask({"do": "roll", "target": "TO5"})
    assert ros.calls == []
    assert "is not what this page has selected now" in answers[0]["answer"]["words"]


def test_keys_of_a_session_are_passed_on_with_what_they_answer(gate):
    ros, _, _, ask = gate
    for key in ("y", "enter", "3"):
        ask({"do": "key", "key": key, "panel": "the newest"})
    assert ros.calls == [("press", key, "the newest") for key in ("y", "enter", "3")]
    ros.facts.trial = None
    ask({"do": "key", "key": "y", "panel": "the newest"})
    assert len(ros.calls) == 3
