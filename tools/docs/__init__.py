"""What of the documentation is made from code. `python -m tools.docs` writes it, the contract tests hold it fresh."""
