# SPDX-License-Identifier: Apache-2.0
"""The live stack for the Foxglove app. Knows nothing of `web`."""
