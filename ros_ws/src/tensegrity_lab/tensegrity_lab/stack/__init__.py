"""The running stack as a program sees it: start it, watch it, ask it, stop it."""
