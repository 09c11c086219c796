# SPDX-License-Identifier: Apache-2.0
"""The robot without hardware: its structure, the VFIFE solver, rolls, gaits, and what they do on robots that are a little off."""
