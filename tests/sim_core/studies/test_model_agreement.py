# SPDX-License-Identifier: Apache-2.0
import pytest

from sim_core.dynamics.model import build_model
from sim_core.errors import LibraryError, SimError
from sim_core.gaits.library import LIBRARIES
from sim_core.structure.elements import PREVIOUS
from sim_core.studies.model_agreement import compare, load_gaits, verdicts


def test_the_papers_own_counts_give_the_papers_own_rates():
    """Ten gaits: all predicted by the previous model, 5 6 10 rejected by the improved one; 5 6 9 10 fail in experiment."""
    succeeded = [n not in (5, 6, 9, 10) for n in range(1, 11)]
    previous, improved = compare([True] * 10, succeeded), compare([n not in (5, 6, 10) for n in range(1, 11)], succeeded)
    assert previous.precision == pytest.approx(0.60)
    assert improved.precision == pytest.approx(0.8571, abs=5e-5)
    assert (previous.agreement, improved.agreement) == (0.6, 0.9)
    assert previous.recall == improved.recall == 1.0


def test_rates_that_do_not_exist_are_none():
    assert compare([False, False], [False, False]).precision is None
    assert compare([False, False], [False, False]).recall is None
    with pytest.raises(SimError, match="nothing to compare"):
        compare([], [])


def test_a_list_of_gaits_runs_on_both_models(tmp_path, model):
    path = tmp_path / "gaits.yaml"
    path.write_text(
        "gaits:\n- {name: still, from: TC6, to: TO5, policy_mm: [0, 0, 0, 0, 0, 0]}\n"
        "- {from: TO5, to: TC6, policy_mm: [40, -26, -20, -19, -31, -43]}\n"
    )
    gaits = load_gaits(path, 45)
    assert [gait.name for gait in gaits] == ["still", "2"]
    assert verdicts(model, gaits) == [False, True]
    assert verdicts(build_model(model.prototype, kind=PREVIOUS), gaits)[0] is False


def test_a_library_is_a_list_of_gaits_too():
    path = LIBRARIES / "robust.yaml"
    assert len(load_gaits(path, 45, every_gait=True)) == 24 * len(load_gaits(path, 45))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gaits: 3", r"valid is a mapping with gaits"),
        ("gaits: [{from: TC6, to: TO5}]", r"gait 1 is .*valid is \{name, from, to"),
        ("gaits: [{from: TC6, to: TO1, policy_mm: [0,0,0,0,0,0]}]", "gait 1: TO1 is not adjacent to TC6"),
        ("gaits: [{from: TC6, to: TO5, policy_mm: [0,0,0,0,0,99]}]", "gait 1: S6 = 99 mm"),
        ("gaits: [", "is not valid YAML"),
    ],
)
def test_a_bad_list_is_refused_naming_the_row(tmp_path, text, message):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(LibraryError, match=message):
        load_gaits(path, 45)
