"""What the robot is: nodes, struts, tendons, faces, symmetry, parameters. numpy only."""
