# SPDX-License-Identifier: Apache-2.0
"""What is read from disk: bounded, strict, and told in one line when it is damaged.

May import `errors` only, and loads neither numpy nor numba: the bridge reads its files by it, too.
"""
