# SPDX-License-Identifier: Apache-2.0
"""What is remembered of one robot over restarts: last pulses, duty, and whose they are.

May import `link`, `safety` and the rooms below; not `recording`.
"""
