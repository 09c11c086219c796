# SPDX-License-Identifier: Apache-2.0
"""The node `twin`, and what RViz draws of it."""
