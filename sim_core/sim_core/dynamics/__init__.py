# SPDX-License-Identifier: Apache-2.0
"""The VFIFE solver: forces, one step, one robot, its support and its actuators. numba is first loaded here."""
