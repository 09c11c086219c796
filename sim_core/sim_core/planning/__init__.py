"""Which rolls to make: between faces, and to a point on the floor."""
