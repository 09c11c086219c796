"""How late a virtual prototype is."""

import pytest

from sixstrut_cli import lateness
from sixstrut_cli.lateness import Lateness


def test_late_is_what_comes_later_than_the_best_so_far(monkeypatch):
    clock = iter([100.0, 101.0, 102.5, 103.0])
    monkeypatch.setattr(lateness.time, "monotonic", lambda: next(clock))
    late = Lateness(time_scale=8.0)
    late.saw(0)
    late.saw(8_000_000_000)
    assert late.worst_s == pytest.approx(0.0)
    late.saw(16_000_000_000)
    assert late.late_s == late.worst_s == pytest.approx(0.5)
    late.saw(24_000_000_000)
    assert (late.late_s, late.worst_s) == pytest.approx((0.0, 0.5))
    late.forget()
    assert late.worst_s == pytest.approx(0.0)
