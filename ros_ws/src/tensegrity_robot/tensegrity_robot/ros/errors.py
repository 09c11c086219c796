# SPDX-License-Identifier: Apache-2.0
"""Errors of the nodes."""

from hardware_bridge.errors import BridgeError


class StartError(BridgeError):
    """A node cannot start: one line that says why and what is valid. The process ends with exit code 1."""
