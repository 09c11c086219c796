# SPDX-License-Identifier: Apache-2.0
"""What the solver is compared with, one module a topic of mechanics: beams, cables, contact, motion, the whole robot."""
