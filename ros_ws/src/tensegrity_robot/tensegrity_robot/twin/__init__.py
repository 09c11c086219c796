"""The node `twin`, and what RViz draws of it."""
