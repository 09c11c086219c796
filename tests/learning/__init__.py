# SPDX-License-Identifier: Apache-2.0
"""What learning from trials is worth: a demonstration on hidden virtual robots."""
