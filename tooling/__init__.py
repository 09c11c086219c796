# SPDX-License-Identifier: Apache-2.0
"""Set-up: makes the environment and builds the workspace. Standard library only; of the other packages, only the table of commands."""
