# SPDX-License-Identifier: Apache-2.0
"""The running stack as a program sees it: start it, watch it, ask it, stop it."""
