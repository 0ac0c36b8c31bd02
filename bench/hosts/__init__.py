"""Two hosts with a bad link between them: what arrives, what is counted lost, that it heals."""
