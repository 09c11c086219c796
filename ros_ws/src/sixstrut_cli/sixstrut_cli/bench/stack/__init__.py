"""What `sixstrut bench --stack` measures: the stack's own cost, with its real processes over the virtual prototype on a pty."""
