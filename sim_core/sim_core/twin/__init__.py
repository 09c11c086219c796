# SPDX-License-Identifier: Apache-2.0
"""The digital twin, without ROS: it follows a bridge's events bit for bit.

May import `dynamics`, `gaits`, `structure`, `files` and `errors`; not `rolling`: it follows, and judges nothing.
"""
