# SPDX-License-Identifier: Apache-2.0
"""When an inertial sensor's word about the face may be taken: never from a sensor that is frozen, late, gone or turned.

Struts, or a person, move the robot; nothing else does. So a face that changes while no strut was driven, a face that is far from
the one before, and a motion of the struts of which the sensor shows nothing are signs of a fault: then the face is unknown until
somebody says it, and the sensor agrees.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from sim_core.sensing import face_filter as f
from sim_core.sensing.face_filter import BESIDE, BEYOND, NAMES, NONE, FilterRules, Shape
from sim_core.sensing.heading import Heading
from sim_core.structure.arrays import Array

SURE, SURE_KNOWN = 0.99, 0.995
"""What is less likely is not said; where the slope is known, faces that are so unsure are nearly one plane: shapes may be wrong."""
LOOK_S = 0.02
"""Between looks at the faces."""
UNSURE_S = 1.0
"""What is unsure at rest for so long stays so."""
LIES_RAD, BALANCES_M, TUMBLES_RAD_S = 0.087, 0.006, 2.0
"""In motion, a robot that is farther from lying on a face (5 degrees), or whose centre of mass is not so far inside it, may be
balancing on an edge of it; one that turns faster is passing it by."""
NONE_PRIOR = 0.01
"""Of resting on no face."""
LEAST_PRIOR = 0.005
"""Of a face that a roll may lead to by passing over another."""
LASTS_S = 0.06
"""A robot that tumbles passes by faces; what does not last so long is not said."""
FROZEN_S = 0.25
"""No sensor repeats all its figures for so long: its noise is larger than its last digit."""
GAP_S = 0.25
"""Longer without a measurement, and turns may have been missed."""
APART_S = 0.15
"""Rates and accelerations may disagree for so long: a landing shakes the box."""
REST_S = 0.6
"""Quiet for so long after the struts' last motion is at rest."""
ANCHOR_S, TIPPED_RAD, FIRM_M = 2.0, 0.1, 0.008
"""As long as the robot is on a face, the floor's normal follows that of the face in this time; not once it has tipped so far, nor
when its centre of mass comes so near to an edge: it may tip slowly."""
_SLIPPED = ": was it turned by hand, or did the sensor slip in its mount?"
SHOWS_PART, SHOWS_RAD, SHOWS_S = 0.1, 0.05, 2.0
"""Of what the twin's box turns in a motion, if that is so much at least, the sensor shows this part, so long after it at most."""


class Word(NamedTuple):
    """News of the face.

    Attributes:
        face: the robot is on it; empty: nobody knows.
        settled: at rest.
        detail: for people: how sure, or why it is not known.
    """

    face: str
    settled: bool
    detail: str


@dataclass
class FaceWatch:
    """Takes measurements, the struts' motions, the twin's shape and what others say; gives words.

    Attributes:
        box_share: of the box in the robot's mass.
        known: the face that was said last, by this or by others; empty: none.
        doubt: why the sensor is not trusted; empty: it is.
        heading: beside the twin's.
    """

    box_share: float
    rules: FilterRules = field(default_factory=FilterRules)
    known: str = ""
    doubt: str = ""
    heading: Heading = field(default_factory=Heading)
    _state: Array | None = None
    _shape: Shape | None = None
    _time_s: float = 0.0
    _last: Array = field(default_factory=lambda: np.zeros(6))
    _same_s: float = 0.0
    _driven: bool = False
    _lengths_m: Array | None = None
    _twin: Array = field(default_factory=lambda: np.array((1.0, 0.0, 0.0, 0.0)))
    _from: Array = field(default_factory=lambda: np.array((1.0, 0.0, 0.0, 0.0)))
    _expected_rad: float = 0.0
    _own: bool = False
    _driven_s: float = 0.0
    _shown_rad: float = 0.0
    _moved: bool = False
    _told: tuple[str, bool] = ("", False)
    _before: str = ""
    _vouched: str = ""
    _looked_s: float = 0.0
    _seen: tuple[str, bool] = ("", False)
    _seen_s: float = 0.0
    _belief: Array = field(default_factory=lambda: _prior("", moved=True))

    # ---- what is heard ----------------------------------------------------------------------------------------------

    def shape(self, joints_m: Array, box_m: Array, box_quaternion: Array) -> None:
        """The twin's shape now: joints (12, 3), box (3,) and (w, x, y, z)."""
        self._shape = f.shape_of(joints_m, box_m, box_quaternion, self.box_share)
        self._twin = np.array(box_quaternion)
        self._expected_rad = max(self._expected_rad, 2.0 * math.acos(min(1.0, abs(float(self._twin @ self._from)))))
        if self._state is not None and self.known:
            self.heading.compare(self._state, self._last[:3], box_quaternion)

    def struts(self, lengths_m: Sequence[float] | Array, wrote: bool) -> None:
        """Rest lengths (6,) as they were sent last; whether that was just now. After that the robot's rest is told again."""
        lengths = np.array(lengths_m)
        driven = wrote and self._lengths_m is not None and not np.array_equal(lengths, self._lengths_m)
        if driven and not self._driven:
            self._moved, self._shown_rad, self._vouched = True, 0.0, ""
            self._from, self._expected_rad = self._twin, 0.0
        if wrote:
            self._told = (self.known, False)
        if driven:
            self._driven_s = self._time_s
        self._driven, self._lengths_m = driven, lengths

    def said(self, face: str) -> None:
        """Somebody else says the face (empty: on none, or nobody knows). A doubt ends if the sensor agrees."""
        self._vouched = face
        if face and self._best() == (face, True):
            self.doubt = ""
        self.known, self._told = face, (face, True)
        self._before = face or self._before
        if not self._driven:
            self._moved = False

    def measured(self, time_s: float, rate_rad_s: Array, acceleration_m_s2: Array) -> Word | None:
        """A measurement in the box's frame, (3,) each; news, if there are any."""
        dt_s = time_s - self._time_s
        if dt_s < -GAP_S:
            self._time_s = self._looked_s = self._seen_s = self._driven_s = time_s
            return self._lost("the clock of its measurements went back")
        if dt_s <= 0.0:
            return None  # told twice, or out of order
        if fault := self._fault(dt_s, np.concatenate((rate_rad_s, acceleration_m_s2))):
            self._time_s = time_s
            return self._lost(fault)
        self._time_s = time_s
        if self._state is None or self._shape is None:
            self._state = f.new_state(acceleration_m_s2)
            return None
        if self._driven:
            self._driven_s = time_s
        f.track(self._state, dt_s, rate_rad_s, acceleration_m_s2, not self._driven, self.rules)
        self._shown_rad += dt_s * max(0.0, float(np.linalg.norm(rate_rad_s - self._state[f.BIAS : f.BIAS + 3])) - 0.02)
        if self._state[f.APART_S] > APART_S and not self.doubt:
            return self._doubted(f"the sensor's accelerations turned and its rates did not{_SLIPPED}")
        if time_s - self._looked_s < LOOK_S - 1e-6:
            return None
        self._looked_s = time_s
        if self.known and self._state[f.SLOPE_KNOWN] > 0.0:
            self._follow(NAMES.index(self.known))
        belief = _prior(self._before, self._moved or not self.known) * f.likelihoods(self._state, *self._shape, self.rules)
        self._belief = belief / belief.sum()
        return self._word()

    def _follow(self, face: int) -> None:
        """The floor's normal follows a face's slowly, while the robot is firmly on it."""
        assert self._state is not None
        assert self._shape is not None
        corners, normal = self._shape.corners_m[face], self._shape.normals[face]
        firm = f.inside_m(corners, normal, self._state[f.DOWN : f.DOWN + 3]) > FIRM_M
        if firm and f.residual_rad(self._state, self._shape.normals, face) < TIPPED_RAD:
            f.anchor(self._state, self._shape.normals, face, LOOK_S / ANCHOR_S)

    def _fault(self, dt_s: float, values: Array) -> str:
        """Why a measurement cannot be used; empty: it can."""
        self._same_s = self._same_s + dt_s if np.array_equal(values, self._last) else 0.0
        self._last = values
        if not np.isfinite(values).all():
            return "the sensor sends what is no number"
        if self._state is not None and dt_s > GAP_S:
            return f"no measurement came for {dt_s:.1f} s"
        return "the sensor sends the same figures again and again" if self._same_s > FROZEN_S else ""

    def missing(self, late_s: float) -> Word | None:
        """No measurement came for so long: news, if that is long and struts moved meanwhile, or move later."""
        return self._lost(f"no measurement came for {late_s:.1f} s") if late_s > 2.0 * GAP_S else None

    def unshaped(self) -> Word | None:
        """The twin is silent: without its shape nothing can be told."""
        self._shape = None
        return self._lost("no twin tells the shape")

    def distrust(self, why: str) -> Word | None:
        """The measurements may be somebody else's: news, unless that is known already."""
        return None if self.doubt else self._doubted(why)

    def begin_anew(self) -> None:
        """What was measured is of another time. What was said stays known."""
        self._state, self._belief, self._vouched = None, _prior("", moved=True), ""
        self.heading.begin_anew()

    def tell_again(self) -> None:
        """What was said was not heard."""
        self._told = ("", False)

    # ---- what is known ----------------------------------------------------------------------------------------------

    @property
    def probabilities(self) -> Array:
        """Of the twenty faces, (20,); what they lack of 1 is that of none."""
        return self._belief[:NONE].copy()

    @property
    def moving(self) -> bool:
        """The robot moves, or was not quiet for long enough yet."""
        return self._state is None or bool(self._state[f.QUIET_S] < REST_S) or self._time_s - self._driven_s < REST_S

    @property
    def residual_rad(self) -> float:
        """By how much the likeliest face's normal is off; NaN: nothing is known."""
        if self._state is None or self._shape is None:
            return float("nan")
        return f.residual_rad(self._state, self._shape.normals, int(np.argmax(self.probabilities)))

    def _best(self) -> tuple[str, bool]:
        """The likeliest face, empty: none of them, and whether that is sure."""
        best = int(np.argmax(self._belief))
        known = self._state is not None and self._state[f.SLOPE_KNOWN] > 0.0
        return NAMES[best] if best < NONE else "", bool(self._belief[best] >= (SURE_KNOWN if known else SURE))

    def _word(self) -> Word | None:
        """What is to be said after a measurement."""
        assert self._state is not None
        assert self._shape is not None
        (face, sure), settled = self._best(), not self.moving
        if (face, sure) != self._seen:
            self._seen, self._seen_s = (face, sure), self._time_s
        if self.doubt and settled and sure and face == self._vouched:
            self.doubt = ""
        hides = self._moved and self._expected_rad > SHOWS_RAD and self._shown_rad < SHOWS_PART * self._expected_rad
        if self.doubt or hides or self._time_s - self._seen_s < LASTS_S - 1e-6:
            stays = hides and not self.doubt and settled and self._time_s - self._driven_s > SHOWS_S
            return self._doubted("the struts moved, and the sensor shows nothing of it: is it fixed to the box?") if stays else None
        if not sure or not face:
            return self._unsure() if settled and self._time_s - self._seen_s > UNSURE_S else None
        if self.known and face != self.known and not self._moved:
            why = f"it stood on {self.known} and stands on {face}, though no strut was driven{_SLIPPED}"
            return self._doubted(why) if settled else None
        down, place = self._state[f.DOWN : f.DOWN + 3], NAMES.index(face)
        balances = f.inside_m(self._shape.corners_m[place], self._shape.normals[place], down) < BALANCES_M
        tumbles = balances or self.residual_rad > LIES_RAD or np.linalg.norm(self._last[:3]) > TUMBLES_RAD_S
        if not settled and (self._state[f.SLOPE_KNOWN] == 0.0 or face == self.known or tumbles):
            return None
        if self._before not in ("", face) and _prior(self._before, moved=True)[NAMES.index(face)] < LEAST_PRIOR:
            why = f"it stood on {self._before} and stands on {face}, which is far from it{_SLIPPED}"
            return self._doubted(why) if settled else None
        if settled:
            f.anchor(self._state, self._shape.normals, NAMES.index(face))
            self._moved = False
        if (face, settled) == self._told:
            return None
        self.known = self._before = face
        self._told, self._own = (face, settled), True
        return Word(face, settled, f"{100.0 * float(self._belief.max()):.1f} %")

    def _unsure(self) -> Word | None:
        """At rest, and no face fits well enough: perhaps the floor was taken for that of another face."""
        assert self._state is not None
        f.forget_slope(self._state)
        self._before = ""
        if not self.known:
            return None
        known, self.known, self._told = self.known, "", ("", False)
        face = NAMES[int(np.argmax(self.probabilities))]
        fits = f"{face} fits best, {100.0 * float(self.probabilities.max()):.1f} %"
        return Word("", False, f"it stood on {known}; {fits}, which is not sure")

    def _doubted(self, why: str) -> Word:
        self.doubt = f"{why.removesuffix('.')}{'' if why.endswith('?') else '.'} Say the face when that is mended"
        self.known, self._told = "", ("", False)
        self.begin_anew()
        return Word("", False, self.doubt)

    def _lost(self, why: str) -> Word | None:
        """Measurements cannot be used: it begins anew. What was known stays known, unless struts move."""
        self.begin_anew()
        if not (self._moved and self.known and self._own):  # it has told nothing that others could rely on
            return None
        self.known, self._told, self._own = "", ("", False), False
        return Word("", False, f"{why}, while the struts moved")


def _prior(before: str, moved: bool) -> Array:
    """Of each face and of none before anything is measured, (21,): flat at first, and flat over where a motion may have led.

    What rehearsals expect of a gait is none of its business: rates that are compared with these must not be coloured by them.
    """
    prior = np.full(NONE + 1, (1.0 - NONE_PRIOR) / NONE)
    prior[NONE] = NONE_PRIOR
    if before:
        own = NAMES.index(before)
        prior[:NONE] = 0.01 / NONE
        prior[BESIDE[own]] += 0.2 if moved else 0.005
        prior[list(BEYOND[own])] += LEAST_PRIOR if moved else 0.0
        prior[own] += 1.0 - prior.sum()
    return prior
