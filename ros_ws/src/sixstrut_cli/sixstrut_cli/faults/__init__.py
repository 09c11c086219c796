"""The failures that must be survived, each as a scenario with real processes, a real pty and the real nodes."""
