# SPDX-License-Identifier: Apache-2.0
"""Which robots this one might be: laws, samples, ensembles, weights."""
