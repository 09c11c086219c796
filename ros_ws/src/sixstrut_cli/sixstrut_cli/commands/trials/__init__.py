"""Commands for sessions of trials and their bags."""
