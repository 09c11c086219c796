# SPDX-License-Identifier: Apache-2.0
"""Failures made to happen to the stack, and what must come of each."""
