"""Monte Carlo over rolls: robustness, rehearsal, sensitivity, fits."""
