# SPDX-License-Identifier: Apache-2.0
"""What the robot is: nodes, struts, tendons, faces, symmetry, parameters. numpy only."""
