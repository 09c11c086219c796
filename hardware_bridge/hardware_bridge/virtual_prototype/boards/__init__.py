# SPDX-License-Identifier: Apache-2.0
"""Emulated servo boards, by the bytes they take and answer.

May import `hardware_bridge.boards` for the bytes of the real ones.
"""
