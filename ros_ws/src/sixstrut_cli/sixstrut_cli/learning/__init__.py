"""Learning from trials: fitted ensembles, odds of one robot, and a demonstration of both."""
