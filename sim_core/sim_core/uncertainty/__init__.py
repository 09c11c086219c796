"""Which robots this one might be: laws, samples, ensembles, weights."""
