# SPDX-License-Identifier: Apache-2.0
"""The robot in a browser, and in the Foxglove app."""
