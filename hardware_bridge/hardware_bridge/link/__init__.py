# SPDX-License-Identifier: Apache-2.0
"""Bytes to and from one board: port, writes, replies, loss, what waits in it. It sends what it is given."""
