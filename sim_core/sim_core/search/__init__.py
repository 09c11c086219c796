"""Finding primitives: a genetic algorithm and what it tries them on."""
