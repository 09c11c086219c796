# SPDX-License-Identifier: Apache-2.0
"""What is read from disk: bounded, strict, and told in one line when it is damaged. Loads neither numpy nor numba."""
