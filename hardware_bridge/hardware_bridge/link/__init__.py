# SPDX-License-Identifier: Apache-2.0
"""Bytes to and from one board: port, writes, replies, loss, backpressure."""
