# SPDX-License-Identifier: Apache-2.0
"""All that the rest may know of a virtual prototype: its handshake, its observer, its faults."""
