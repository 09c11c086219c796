"""The robot in a browser, and in the Foxglove app."""
