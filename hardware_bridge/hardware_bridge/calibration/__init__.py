# SPDX-License-Identifier: Apache-2.0
"""Length of a strut to pulse of its servo, both ways, and the file that says how."""
