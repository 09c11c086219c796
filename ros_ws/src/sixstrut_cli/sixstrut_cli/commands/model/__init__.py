"""Commands that need no robot and no stack."""
