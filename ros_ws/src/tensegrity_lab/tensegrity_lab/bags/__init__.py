# SPDX-License-Identifier: Apache-2.0
"""Recorded sessions read back: replayed, played, judged.

May import `session_data`, `stack`, `terminal` and `errors`, and the packages below.
"""
