# SPDX-License-Identifier: Apache-2.0
"""What a session of trials is on disk: plan, ledger, folder, and the same in the bag.

May import `stack`, `terminal` and `errors`, and the packages below.
"""
