# SPDX-License-Identifier: Apache-2.0
"""The node `twin`, and what RViz draws of it.

May import `ros`, and of the other packages `hardware_bridge` and `sim_core`.
"""
