# SPDX-License-Identifier: Apache-2.0
"""Commands for a robot, real or virtual."""
