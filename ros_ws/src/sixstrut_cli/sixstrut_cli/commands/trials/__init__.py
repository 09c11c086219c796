# SPDX-License-Identifier: Apache-2.0
"""Commands for sessions of trials and their bags."""
