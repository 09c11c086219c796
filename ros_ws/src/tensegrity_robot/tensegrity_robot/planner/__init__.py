# SPDX-License-Identifier: Apache-2.0
"""The nodes `gait_planner` and `traveller`."""
