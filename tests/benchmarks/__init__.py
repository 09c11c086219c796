# SPDX-License-Identifier: Apache-2.0
"""What the solver and the stack cost."""
