"""The stack's own cost: processor, memory, latencies, bags."""
