# SPDX-License-Identifier: Apache-2.0
"""MCAP bags: written so that a crash loses little, read so that damage does no harm."""
