"""Travels of the virtual prototype: one, or a study of many, through the whole stack."""
