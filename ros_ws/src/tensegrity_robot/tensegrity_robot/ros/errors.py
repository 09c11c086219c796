# SPDX-License-Identifier: Apache-2.0
"""Errors of the nodes."""


class StartError(Exception):
    """A node cannot start: one line that says why and what is valid. The process ends with exit code 1."""
