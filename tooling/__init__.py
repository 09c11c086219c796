# SPDX-License-Identifier: Apache-2.0
"""Set-up: makes the environment and builds the workspace.

Standard library only; of the other packages it imports the table of commands.
"""
