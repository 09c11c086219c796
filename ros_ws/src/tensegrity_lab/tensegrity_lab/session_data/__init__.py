"""What a session of trials is on disk: plan, ledger, folder, and the same in the bag."""
