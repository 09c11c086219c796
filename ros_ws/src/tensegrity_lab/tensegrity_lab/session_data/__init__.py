# SPDX-License-Identifier: Apache-2.0
"""What a session of trials is on disk: plan, ledger, folder, and the same in the bag."""
