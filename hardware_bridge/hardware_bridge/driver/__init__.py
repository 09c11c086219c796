# SPDX-License-Identifier: Apache-2.0
"""The running bridge: engine, frame timer, the port's process and its remote."""
