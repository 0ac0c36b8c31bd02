"""Bad input on purpose: mutations of good input, and the coverage-guided campaigns over every reader."""
