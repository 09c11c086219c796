# SPDX-License-Identifier: Apache-2.0
"""The judge of shapes for a bridge: made in a thread, because loading (and, the first time, compiling) takes its time."""

import threading

from sim_core.errors import SimError
from sim_core.structure.parameters import load_prototype

READY_LIMIT_S = 180.0
"""The first time on a machine everything is compiled."""


class ShapeRule:
    """What `hardware_bridge.safety.limit_checks.Rules` wants: six rest lengths (m) -> what is wrong, or the struts' forces (N).

    A call waits until the rule is ready.
    """

    def __init__(self, prototype_file: str, slack_limit: int):
        """Raises ParameterError: the file cannot be read or holds an impossible value. An empty name: the nominal robot."""
        self._prototype = load_prototype(prototype_file or None)
        self._slack_limit = slack_limit
        self._ready = threading.Event()
        self._problem = ""
        threading.Thread(target=self._make, name="shape judge", daemon=True).start()

    def __call__(self, lengths_m: tuple[float, ...]) -> str | tuple[float, ...]:
        """What is wrong with six rest lengths (m), or the axial forces of the struts (N)."""
        if not self._ready.wait(READY_LIMIT_S):
            return f"the judge of shapes did not become ready within {READY_LIMIT_S:g} s; start the bridge again"
        return self._problem or self._judge.verdict(lengths_m)

    def _make(self) -> None:
        try:
            from sim_core.rolling.shape_check import ShapeJudge, ShapeLimits

            self._judge = ShapeJudge(self._prototype, ShapeLimits.of(self._prototype, self._slack_limit))
            self._judge([self._prototype.strut_length_m] * 6)
        except SimError as error:
            self._problem = f"no shape can be judged: {error}"
        except Exception as error:  # whatever it is: without a judge nothing moves
            self._problem = f"no shape can be judged, internal error: {error!r}"
        finally:
            self._ready.set()
