# SPDX-License-Identifier: Apache-2.0
"""Emulated servo boards, by the bytes they take and answer."""
