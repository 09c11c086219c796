# SPDX-License-Identifier: Apache-2.0
"""The nodes `gait_planner` and `traveller`.

May import `ros`, and of the other packages `hardware_bridge` and `sim_core`.
"""
