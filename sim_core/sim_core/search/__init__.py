# SPDX-License-Identifier: Apache-2.0
"""Finding primitives: a genetic algorithm and what it tries them on.

May import every room here.
"""
