# SPDX-License-Identifier: Apache-2.0
"""Proofs of life of the lease's holder: a counter that only who has the lease can go on with.

The lease is a secret between the bridge and whom it armed. It is on no topic: what is sent again and again is a counter and its
HMAC keyed by the lease, so that whoever listens can neither command nor keep a silent holder's lease alive.
"""

import hashlib
import hmac


def proof_of(lease: str, counter: int) -> bytes:
    """HMAC-SHA256 of a counter (0 to 2**64 - 1), keyed by the lease."""
    return hmac.new(lease.encode(), counter.to_bytes(8, "little"), hashlib.sha256).digest()


class Prover:
    """The holder's side. Attributes: counter: of the newest proof."""

    def __init__(self, lease: str) -> None:
        self.counter = 0
        self._lease = lease

    def next(self) -> tuple[int, bytes]:
        """The next counter and its proof."""
        self.counter += 1
        return self.counter, proof_of(self._lease, self.counter)


class Verifier:
    """The bridge's side, for one lease."""

    def __init__(self, lease: str) -> None:
        self._lease = lease
        self._counter = 0

    def accepts(self, counter: int, proof: bytes) -> bool:
        """Whether this is a proof of this lease, newer than every one before."""
        if not self._counter < counter < 2**64 or not hmac.compare_digest(proof, proof_of(self._lease, counter)):
            return False
        self._counter = counter
        return True
