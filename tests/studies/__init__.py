# SPDX-License-Identifier: Apache-2.0
"""Studies through the twin and the whole stack, for the pages in docs/results."""
