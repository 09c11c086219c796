# SPDX-License-Identifier: Apache-2.0
"""Bytes to and from one board: port, writes, replies, loss, what waits in it.

May import `calibration`, `boards` and `errors`; not `safety`: it sends what it is given.
"""
