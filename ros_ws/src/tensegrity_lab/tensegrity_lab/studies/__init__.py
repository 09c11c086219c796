"""What a command computes or runs for long: campaigns, fits, travels, climbs, the demo."""
