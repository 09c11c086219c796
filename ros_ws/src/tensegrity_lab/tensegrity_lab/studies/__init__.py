# SPDX-License-Identifier: Apache-2.0
"""What a command computes or runs for long: campaigns, fits, travels, climbs, the demo."""
