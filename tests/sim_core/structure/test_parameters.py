# SPDX-License-Identifier: Apache-2.0
from dataclasses import fields, replace

import pytest
import yaml

from sim_core.errors import ParameterError
from sim_core.structure.parameters import FILE, SPECS, Prototype, load_prototype


def written(tmp_path, change):
    document = yaml.safe_load(FILE.path.read_text(encoding="utf-8"))
    change(document)
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def test_every_number_has_unit_source_and_range():
    entries = FILE.load()
    assert {entry.name for entry in entries} == SPECS.keys() == {field.name for field in fields(Prototype)}
    assert all(entry.unit == SPECS[entry.name].unit for entry in entries)


def test_values_that_the_paper_gives_are_tagged_so_and_guesses_are_not():
    source = {entry.name: entry.source for entry in FILE.load()}
    assert source["box_mass_kg"] == source["first_frequency_hz"] == source["mass_damping_ratio"] == "paper"
    assert source["strut_bending_stiffness_n_m2"] == source["friction_static"] == "stand-in"
    assert source["tendon_stiffness_n_m"] == source["box_rope_stiffness_n_m"] == "calibrated"


def test_mass_damping_follows_from_ratio_and_frequency():
    assert load_prototype().zeta_1_s == pytest.approx(2.846, abs=5e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("box_mass_kg"), "missing: box_mass_kg"),
        (lambda d: d.update(colour={"value": 1, "unit": "1", "source": "design"}), "unknown: colour"),
        (lambda d: d["box_mass_kg"].update(value=-1), r"box_mass_kg = -1: valid is a number in \[0.001, 100\] kg"),
        (lambda d: d["box_mass_kg"].update(value=float("nan")), "box_mass_kg = nan: valid is"),
        (lambda d: d["box_mass_kg"].update(value="heavy"), "box_mass_kg = 'heavy': valid is"),
        (lambda d: d["box_mass_kg"].update(unit="g"), "unit 'g'; valid is 'kg'"),
        (lambda d: d["box_mass_kg"].update(source="guess"), "source 'guess'; valid are paper"),
        (lambda d: d["strut_elements"].update(value=1.5), "strut_elements = 1.5: valid is a whole number"),
        (lambda d: d["joint_inertia_kg_m2"].update(value=[1e-5, 1e-5]), "list of 3"),
        (lambda d: d["friction_kinetic"].update(value=0.7), "friction_kinetic = 0.7 is above friction_static"),
        (lambda d: d["policy_limit_mm"].update(value=60), "policy_limit_mm = 60 is beyond the stops"),
        (lambda d: d.update(schema=9), "schema 9 is not known"),
    ],
)
def test_a_bad_file_is_refused_naming_what_was_got_and_what_is_valid(tmp_path, change, message):
    with pytest.raises(ParameterError, match=message):
        load_prototype(written(tmp_path, change))


def test_broken_yaml_is_refused_with_file_and_line(tmp_path):
    path = tmp_path / "broken.yaml"
    path.write_text("schema: 1\nbox_mass_kg: {value: 1,\nfoo: [", encoding="utf-8")
    with pytest.raises(ParameterError, match=r"broken\.yaml is not valid YAML at line \d"):
        load_prototype(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ParameterError, match=r"nowhere\.yaml: No such file"):
        load_prototype(tmp_path / "nowhere.yaml")


def test_the_hash_follows_the_numbers_only(tmp_path):
    nominal = load_prototype()
    renoted = load_prototype(written(tmp_path, lambda d: d["box_mass_kg"].update(note="weighed", source="measured")))
    assert renoted.hash == nominal.hash
    assert replace(nominal, box_mass_kg=0.13).hash != nominal.hash
