# SPDX-License-Identifier: Apache-2.0
"""Primitives, their 24 gaits, how probable each is to succeed, and doing one.

May import `structure`, `files` and `errors`: what a gait is needs no solver.
"""
