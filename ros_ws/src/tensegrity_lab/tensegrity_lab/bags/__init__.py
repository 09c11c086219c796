# SPDX-License-Identifier: Apache-2.0
"""Recorded sessions read back: replayed, played, judged."""
