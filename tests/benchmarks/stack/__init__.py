# SPDX-License-Identifier: Apache-2.0
"""The stack's own cost: processor, memory, latencies, bags."""
