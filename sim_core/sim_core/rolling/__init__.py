# SPDX-License-Identifier: Apache-2.0
"""What a roll is, and whether it succeeded: one, or many at once.

May import `dynamics`, `gaits`, `structure`, `files` and `errors`.
"""
