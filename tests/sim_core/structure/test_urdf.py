# SPDX-License-Identifier: Apache-2.0
"""The robot as viewers get it: a valid tree, of the robot's own sizes, masses and places."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from sim_core.structure.elements import elements_of
from sim_core.structure.parameters import load_prototype
from sim_core.structure.topology import STRUTS
from sim_core.structure.urdf import LINKS, urdf


@pytest.fixture(scope="module")
def prototype():
    return load_prototype()


@pytest.fixture(scope="module")
def tree(prototype):
    return ElementTree.fromstring(urdf(prototype))


def numbers(text):
    return np.array([float(word) for word in text.split()])


def turn_of(rpy):
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    return np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ about_y @ about_x


def test_it_is_one_tree_below_base_link(tree):
    links = [link.get("name") for link in tree.findall("link")]
    children = [joint.find("child").get("link") for joint in tree.findall("joint")]
    assert len(set(links)) == len(links) == 27
    assert sorted([*children, "base_link"]) == sorted(links)
    hung = {(joint.find("parent").get("link"), joint.get("type")) for joint in tree.findall("joint")}
    assert hung == {("base_link", "floating"), ("box", "fixed")}, "the inertial sensor is fixed to the box"
    materials = {material.get("name") for material in tree.findall("material")}
    assert {material.get("name") for material in tree.findall("link/visual/material")} <= materials


def test_links_have_the_robot_s_mass_and_possible_inertias(tree, prototype):
    inertials = tree.findall("link/inertial")
    assert len(inertials) == 25
    assert sum(float(i.find("mass").get("value")) for i in inertials) == pytest.approx(elements_of(prototype).mass_kg.sum())
    for inertial in inertials:
        a, b, c = sorted(float(inertial.find("inertia").get(axis)) for axis in ("ixx", "iyy", "izz"))
        assert a > 0.0
        assert c <= a + b


def test_joints_lie_where_the_ideal_shape_has_them(tree, prototype):
    e = elements_of(prototype)
    for joint in tree.findall("joint[@type='floating']"):
        index, origin = LINKS[joint.find("child").get("link")], joint.find("origin")
        assert numbers(origin.get("xyz")) == pytest.approx(e.position_m[index], abs=1e-8)
        assert turn_of(numbers(origin.get("rpy"))) == pytest.approx(e.frame[index], abs=1e-8)


def test_a_strut_s_parts_overlap_at_every_length(tree, prototype):
    lengths = {
        link.get("name"): float(link.find("visual/geometry/cylinder").get("length"))
        for link in tree.findall("link")
        if link.find("visual/geometry/cylinder") is not None
    }
    assert len(lengths) == 2 * len(STRUTS)
    shortest = prototype.strut_length_m - prototype.actuator_stroke_m
    longest = prototype.strut_length_m + prototype.actuator_stroke_m
    for name in ("S1", "S6"):
        assert lengths[f"{name}_outer"] + lengths[f"{name}_inner"] >= longest - 1e-9
        assert max(lengths[f"{name}_outer"], lengths[f"{name}_inner"]) <= shortest


def test_every_link_gets_the_prefix(prototype):
    tree = ElementTree.fromstring(urdf(prototype, "blue/"))
    named = [link.get("name") for link in tree.findall("link")]
    named += [joint.find(end).get("link") for joint in tree.findall("joint") for end in ("parent", "child")]
    assert all(name.startswith("blue/") for name in named)
