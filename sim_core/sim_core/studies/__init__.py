# SPDX-License-Identifier: Apache-2.0
"""Monte Carlo over rolls: robustness, rehearsal, sensitivity, fits."""
