"""Emulated servo boards, by the bytes they take and answer."""
