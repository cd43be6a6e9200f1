"""References for the tests: known answers that share no code with the pipeline."""
