# SPDX-License-Identifier: Apache-2.0
"""The running bridge: engine, frame timer, the port's process and its remote.

May import every room here but `virtual_prototype`, which it meets only through a port.
"""
