# SPDX-License-Identifier: Apache-2.0
"""Figures, tables and pages.

May import `bags`, `session_data`, `stack`, `terminal` and `errors`, and the packages below.
"""
