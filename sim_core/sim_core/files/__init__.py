"""What is read from disk: bounded, strict, and told in one line when it is damaged."""
