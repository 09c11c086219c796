# SPDX-License-Identifier: Apache-2.0
import math
from dataclasses import fields

import pytest

from hardware_bridge.errors import ParameterError
from hardware_bridge.safety.limits import Limits, Pacing


def test_the_defaults_are_the_contracts() -> None:
    limits = Limits()
    assert (limits.stroke_m, limits.goal_age_s, limits.lease_silence_s) == (0.045, 0.5, 1.0)
    assert Pacing().period_s == 0.05


@pytest.mark.parametrize("name", [field.name for field in fields(Limits)])
@pytest.mark.parametrize("value", [-1.0, 0.0, 1e9, math.nan, math.inf, True, "0.01", None])
def test_a_limit_outside_its_range_is_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=f"{name} is .*, valid is") as caught:
        Limits(**{name: value})  # type: ignore[arg-type]
    assert caught.value.name == name


def test_frames_faster_than_the_wire_are_refused() -> None:
    with pytest.raises(ParameterError, match="period_s"):
        Pacing(period_s=0.02)
