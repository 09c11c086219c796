# SPDX-License-Identifier: Apache-2.0
"""Commands for whoever works on sixstrut itself."""
