# SPDX-License-Identifier: Apache-2.0
"""The live stack for the Foxglove app.

May import the packages below, not `web`.
"""
