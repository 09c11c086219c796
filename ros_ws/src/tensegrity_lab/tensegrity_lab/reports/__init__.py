# SPDX-License-Identifier: Apache-2.0
"""What rolls, trials, studies and sessions look like: figures, tables and pages.

May import `bags`, `session_data`, `stack`, `terminal` and `errors`, and the packages below.
"""
