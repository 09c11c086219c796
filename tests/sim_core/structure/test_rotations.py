# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_core.structure.rotations import about_z, best_fit, matrix_of, product, quaternion_of, rotated, turn_onto

components = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(c * c for c in q) > 1e-2)


def unit_quaternion(values):
    return np.array(values) / np.linalg.norm(values)


@given(components)
def test_quaternion_and_matrix_are_inverse_up_to_sign(values):
    q = unit_quaternion(values)
    matrix = matrix_of(q)
    assert np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    back = quaternion_of(matrix)
    assert np.allclose(back, q, atol=1e-9) or np.allclose(back, -q, atol=1e-9)
    assert back[np.argmax(np.abs(back))] > 0


@given(components, components)
def test_products_are_matrix_products(a, b):
    ma, mb = matrix_of(unit_quaternion(a)), matrix_of(unit_quaternion(b))
    assert np.allclose(product(ma, mb), ma @ mb, atol=1e-14)
    assert np.allclose(rotated(ma, mb[0]), ma @ mb[0], atol=1e-14)


@pytest.mark.parametrize("source", [(0, 0, -1), (0, 0, 1), (1, 0, 0), (0.6, 0, 0.8)])
def test_turn_onto_carries_one_direction_onto_the_other(source):
    down = np.array([0.0, 0.0, -1.0])
    turn = turn_onto(np.array(source, dtype=float), down)
    assert np.allclose(turn @ source, down)
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_best_fit_finds_the_turn_of_a_cloud_of_points():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(12, 3))
    turn = about_z(0.7) @ turn_onto(np.array([0.6, 0, 0.8]), np.array([0, 1.0, 0]))
    assert np.allclose(best_fit(points, points @ turn.T + [1, 2, 3]), turn)
