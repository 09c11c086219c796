"""MCAP bags: written so that a crash loses little, read so that damage does no harm."""
