"""The live stack for the Foxglove app."""
