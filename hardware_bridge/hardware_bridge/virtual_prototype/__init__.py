# SPDX-License-Identifier: Apache-2.0
"""A robot behind a pty: an emulated servo board, a perturbed body, and an observer in place of a camera."""
