"""What a page may ask for: a gate that knows every order, and refuses the rest with a word."""

import pytest

from sixstrut_cli.console.facts import Selection
from sixstrut_cli.console.running import Orders


class Ros:
    """Writes down what would be asked of the stack; a recorder and no stack, for the gate alone is tested here."""

    def __init__(self):
        self.calls = []

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
    return ros, orders, answers, lambda order: orders.carry_out(order, answers.append)


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
        ({"do": "key", "key": ["y"]}, "unknown order 'key'"),
        ({"do": "key", "key": "rm"}, "unknown order 'key'"),
    ],
)
def test_anything_else_is_refused_with_a_word_and_reaches_nobody(gate, order, words):
    ros, _, answers, ask = gate
    ask(order)
    assert ros.calls == []
    assert answers[0]["answer"]["done"] is False
    assert words in answers[0]["answer"]["words"]


def test_a_selection_moves_nothing_and_asks_for_the_odds(gate):
    ros, orders, answers, ask = gate
    ask({"do": "select", "target": "TO7"})
    assert orders.selection == Selection("TO7")
    assert ros.calls == [("rehearse", "TO7")]
    assert answers == []


def test_keys_of_a_session_are_passed_on(gate):
    ros, _, _, ask = gate
    for key in ("y", "enter", "3"):
        ask({"do": "key", "key": key})
    assert ros.calls == [("press", "y"), ("press", "enter"), ("press", "3")]
