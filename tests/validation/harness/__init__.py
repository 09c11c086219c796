# SPDX-License-Identifier: Apache-2.0
"""How a case is run: any structure stepped, references without the solver."""
