# SPDX-License-Identifier: Apache-2.0
"""Proofs of life: only the holder can go on, and nothing counts twice."""

from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.safety.lease_proof import Prover, Verifier, proof_of

LEASE = "0123456789abcdef"


def test_the_holder_goes_on():
    prover, verifier = Prover(LEASE), Verifier(LEASE)
    assert all(verifier.accepts(*prover.next()) for _ in range(5))


def test_a_proof_counts_once_and_a_lost_one_does_not_matter():
    prover, verifier = Prover(LEASE), Verifier(LEASE)
    first, _lost, third = prover.next(), prover.next(), prover.next()
    assert verifier.accepts(*third)
    assert not verifier.accepts(*third)
    assert not verifier.accepts(*first)


@given(st.integers(2, 2**64 - 1))
def test_who_has_heard_proofs_cannot_go_on(counter):
    prover, verifier = Prover(LEASE), Verifier(LEASE)
    _, heard = prover.next()
    assert not verifier.accepts(counter, heard)
    assert not verifier.accepts(counter, proof_of("another lease", counter))
    assert not verifier.accepts(counter, b"")


def test_no_counter_beyond_eight_bytes():
    assert not Verifier(LEASE).accepts(2**64, bytes(32))
    assert not Verifier(LEASE).accepts(0, proof_of(LEASE, 0))
